"""What bloom reads of each package, and that nobody names another version."""
import pathlib
import re

import pytest
import yaml
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package_version import get_forthcoming_label
from catkin_pkg.packages import find_packages

ROOT = pathlib.Path(__file__).resolve().parents[3]
PACKAGES = {package.name: ROOT / 'src' / path for path, package in find_packages(str(ROOT / 'src')).items()}


def newest():
    """Version and date of the uppermost section of the project's changelog."""
    return re.search(r'^## (\S+) \((.+)\)$', (ROOT / 'CHANGELOG.md').read_text(), re.MULTILINE).groups()


def test_every_package_has_the_version_of_the_changelog():
    version, _ = newest()
    packages = find_packages(str(ROOT / 'src'))
    assert len(packages) == 4 and {package.version for package in packages.values()} == {version}
    assert yaml.safe_load((ROOT / 'CITATION.cff').read_text())['version'] == version


@pytest.mark.parametrize('name', PACKAGES)
def test_its_changelog_is_in_the_format_of_catkin(name):
    """What catkin_prepare_release renames at the next release, or what bloom finds of this one."""
    text = (PACKAGES[name] / 'CHANGELOG.rst').read_text()
    assert f'Changelog for package {name}' in text
    version, date = newest()
    if date == 'unreleased':
        assert get_forthcoming_label(text) == 'Forthcoming'
        return
    assert get_forthcoming_label(text) is None
    assert version in [released for released, _, _ in get_changelog_from_path(str(PACKAGES[name])).foreach_version()]
