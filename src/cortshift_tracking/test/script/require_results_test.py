"""What a run of the tests leaves behind is counted, and nothing that is missing or not whole passes."""
import pytest
from scripts import script

require_results = script('require_results')

GOOD = '<testsuite><testcase classname="Bag" name="reads"/></testsuite>'


def counted(path):
    count = require_results.Count()
    count.results_of(path)
    return count.passed, count.failed


@pytest.mark.parametrize('text, passed, failed', [
    (GOOD, 1, 0), ('<testsuite/>', 0, 1), ('', 0, 1), (GOOD[:30], 0, 1), (None, 0, 1),
    ('<testsuite><testcase classname="Bag" name="reads"><failure/></testcase></testsuite>', 0, 1),
    ('<testsuite><testcase classname="Bag" name="reads"><skipped/></testcase></testsuite>', 0, 1)])
@pytest.mark.parametrize('name', ['gtest-bag_test.xml', 'rosunit-test_bag.xml'])
def test_cases(tmp_path, name, text, passed, failed):
    path = tmp_path / name
    if text is not None:
        path.write_text(text)
    assert counted(path) == (passed, failed)


@pytest.mark.parametrize('outer, inner, passed, failed', [
    (GOOD.replace('reads', 'testbag'), GOOD, 1, 0), (GOOD.replace('reads', 'testbag'), None, 0, 1), ('', GOOD, 0, 1)])
def test_launched(tmp_path, capsys, outer, inner, passed, failed):
    """The file of a launch file names those of the programs that it ran."""
    path = tmp_path / 'rostest-test_bag.xml'
    path.write_text(outer)
    if inner is not None:
        (tmp_path / 'rosunit-bag.xml').write_text(inner)
    assert counted(path) == (passed, failed)
    assert not failed or 'no result: killed at its time limit, or ended early?' in capsys.readouterr().err
