"""What the documents name is there: checks, tests and scripts of the hazards, and every dependency in the list of software."""
import pathlib
import re
import subprocess

ROOT = pathlib.Path(__file__).resolve().parents[4]
DOC = ROOT / 'doc'


def hazards():
    rows = [line.strip('|').split('|') for line in (DOC / 'hazards.md').read_text().splitlines() if line.startswith('| ')]
    return [[cell.strip() for cell in row] for row in rows[2:]]


def test_every_hazard_is_answered_by_something_that_is_there():
    checks = set(re.findall(r'^\| `(\w+)` \|', (DOC / 'checks.md').read_text(), re.MULTILINE))
    tests = {path.stem for path in ROOT.glob('src/*/test/**/*_test.*')}   # house_test sees that each is run
    assert len(hazards()) > 15 and 'supervise_test' in tests
    for hazard, answer, named_checks, named_tests in hazards():
        assert answer and named_tests, hazard
        assert set(re.findall(r'`(\w+)`', named_checks)) <= checks, hazard
        for name in named_tests.split(', '):
            assert (ROOT / name).is_file() if name.startswith('script/') else name in tests, f'{hazard}: {name}'


def test_the_list_of_software_is_complete(tmp_path):
    def check(path):
        return subprocess.run([ROOT / 'script/list_software', '--check', path], capture_output=True, text=True, check=False)
    assert check(DOC / 'software.md').returncode == 0
    shorter = tmp_path / 'software.md'
    shorter.write_text('\n'.join(line for line in (DOC / 'software.md').read_text().splitlines() if not line.startswith('| roscpp ')))
    told = check(shorter)
    assert told.returncode == 1 and 'lacks roscpp' in told.stderr


def test_links_of_the_documents_lead_somewhere():
    for path in [ROOT / 'README.md', *DOC.glob('*.md')]:
        for target in re.findall(r'\]\(([^)#:\s]+)(?:#[^)]*)?\)', path.read_text()):
            assert (path.parent / target).exists(), f'{path.name}: {target}'
