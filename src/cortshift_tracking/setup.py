from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(**generate_distutils_setup(
    packages=['cortshift_tracking', 'cortshift_tracking.cohort', 'cortshift_tracking.export'],
    package_dir={'': 'src'}, package_data={'cortshift_tracking': ['console_page.html']}))
