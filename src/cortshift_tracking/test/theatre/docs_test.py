"""script/docs: the site is built without a warning, every page and the API are in it, and what is wrong stops it."""
import pathlib
import re
import shutil
import subprocess

ROOT = pathlib.Path(__file__).resolve().parents[4]


def build(root, output):
    return subprocess.run([root / 'script/docs', output], capture_output=True, text=True, check=False)


def test_the_site_is_built_and_its_links_resolve(tmp_path):
    done = build(ROOT, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.split() == [str(tmp_path / 'index.html')]
    assert 'PairReconstruction' in (tmp_path / 'api/annotated.html').read_text()
    assert 'href="../api/annotated.html"' in (tmp_path / 'doc/index.html').read_text()
    pages = [path for path in tmp_path.rglob('*.html') if path.name not in ('genindex.html', 'search.html') and path.parent.name != 'api']
    for source in [*(ROOT / 'doc').glob('*.md'), ROOT / 'README.md', ROOT / 'CONTRIBUTING.md']:
        assert tmp_path / source.relative_to(ROOT).with_suffix('.html') in pages, source
    local = 0
    for page in pages:
        for target in re.findall(r'(?:href|src)="([^"#:]+)(?:#[^"]*)?"', page.read_text()):
            assert (page.parent / target).exists(), f'{page.relative_to(tmp_path)}: {target}'
            local += 1
    assert local > 200


def test_what_is_wrong_stops_it(tmp_path):
    def copy(name, text, header=''):
        root = tmp_path / name
        for path in ['README.md', 'CONTRIBUTING.md', 'BENCHMARK.md', 'CHANGELOG.md', 'bags/README.md', 'script/docs', 'script/environment']:
            (root / path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / path, root / path)
        shutil.copytree(ROOT / 'doc', root / 'doc')
        (root / 'doc/first_case.md').write_text(text)
        for package in ('flow', 'stereo', 'tracking'):
            include = root / f'src/cortshift_{package}/include'
            include.mkdir(parents=True)
            (include / f'{package}.hpp').write_text(header)
        return build(root, root / 'out')
    text = (ROOT / 'doc/first_case.md').read_text()
    heading = copy('heading', text + '\n[nowhere](network.md#no-such-heading)\n')
    assert heading.returncode == 1 and 'no-such-heading' in heading.stderr
    page = copy('page', text + '\n[nowhere](no_such_page.md)\n')
    assert page.returncode == 1 and 'no_such_page' in page.stderr
    comment = copy('comment', text, '/// Half of it. @param number  any\ndouble half(double value);\n')
    assert comment.returncode == 1 and "argument 'number'" in comment.stderr
    assert subprocess.run([ROOT / 'script/docs', '--no-such'], capture_output=True, check=False).returncode == 2
