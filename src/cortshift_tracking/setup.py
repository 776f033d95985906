from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

ROOMS = ('case', 'cohort', 'console', 'deidentify', 'export', 'model', 'mr', 'probe', 'report', 'theatre')

setup(**generate_distutils_setup(
    packages=['cortshift_tracking'] + ['cortshift_tracking.' + room for room in ROOMS],
    package_dir={'': 'src'}, package_data={'cortshift_tracking.console': ['page.html']}))
