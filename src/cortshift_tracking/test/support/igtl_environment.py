#!/usr/bin/python3
"""Make the virtual environment with the independent OpenIGTLink client of the tests, unless it is there.

    igtl_environment.py FOLDER

Needs the network the first time: without it this fails, and so does the test that needs the client."""
import os
import shutil
import subprocess
import sys
import tempfile
import venv

# Debian's python3-crcmod and python3-numpy serve it; the test runs it in Debian's Python.
PACKAGE = 'pyigtl==0.3.4'
HASH = 'sha256:80cdefca7f98ee93c4c42ff1560a914244963df45495dde1784720ac9f28fe29'


def make(folder):
    ready = os.path.join(folder, 'ready')
    if os.path.exists(ready):
        return
    print(f'installing {PACKAGE} in {folder}', file=sys.stderr)
    shutil.rmtree(folder, ignore_errors=True)
    venv.create(folder, with_pip=True)
    with tempfile.NamedTemporaryFile('w', suffix='.txt') as requirements:
        requirements.write(f'{PACKAGE} --hash={HASH}\n')
        requirements.flush()
        done = subprocess.run([os.path.join(folder, 'bin', 'pip'), 'install', '--quiet', '--disable-pip-version-check',
                               '--no-deps', '--require-hashes', '--requirement', requirements.name])
    if done.returncode != 0:
        raise RuntimeError(f'{PACKAGE} cannot be installed. The test of the OpenIGTLink bridge needs this client, which '
                           'Debian does not have: run script/test once with a connection to the Python package index, '
                           f'or copy {folder} from a machine where it has been run')
    with open(ready, 'w'):
        pass


if __name__ == '__main__':
    if len(sys.argv) != 2 or sys.argv[1] in ('-h', '--help'):
        print(__doc__)
        sys.exit(0 if sys.argv[1:] in (['-h'], ['--help']) else 2)
    try:
        make(sys.argv[1])
    except (RuntimeError, OSError, subprocess.CalledProcessError) as error:
        print(f'igtl_environment.py: {error}', file=sys.stderr)
        sys.exit(1)
