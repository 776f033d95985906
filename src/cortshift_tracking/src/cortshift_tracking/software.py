"""Which version of cortshift this is."""
import os
import subprocess
import xml.etree.ElementTree as ElementTree

import rospkg


def software_version():
    """Version in this package's manifest, with git's description of the source tree where there is one."""
    folder = rospkg.RosPack().get_path('cortshift_tracking')
    version = ElementTree.parse(os.path.join(folder, 'package.xml')).findtext('version').strip()
    try:
        commit = subprocess.run(['git', '-C', folder, 'describe', '--always', '--dirty'], stdout=subprocess.PIPE,
                                stderr=subprocess.DEVNULL, universal_newlines=True, check=False).stdout.strip()
    except OSError:
        commit = ''
    return f'{version} ({commit})' if commit else version
