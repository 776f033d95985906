"""demo_case says by name what it cannot use."""
import pytest

from offline_tools import run_tool


@pytest.mark.parametrize('text', ['stages: [{sag: 1}]', 'just words', '- a\n- list', 'stages: [', b'\xff\xfe\x00'])
def test_a_file_that_is_no_case(tmp_path, text):
    case = tmp_path / 'case.yaml'
    case.write_bytes(text if isinstance(text, bytes) else text.encode())
    _, said = run_tool('demo_case', case, tmp_path / 'out', status=1)
    assert f'demo_case: {case} is no case of the phantom, a YAML file with `stages`; give one of config/phantom' in said


def test_a_case_that_is_not_there(tmp_path):
    _, said = run_tool('demo_case', tmp_path / 'none.yaml', tmp_path / 'out', status=1)
    assert 'none.yaml cannot be read (No such file or directory); give a case of config/phantom' in said


def test_a_folder_that_cannot_be_written(tmp_path):
    case, file = tmp_path / 'case.yaml', tmp_path / 'file'
    case.write_text('stages: [{name: first}]')
    file.write_text('')
    _, said = run_tool('demo_case', case, file / 'out', status=1)
    assert f'{file / "out"} cannot be written (Not a directory); give a folder that can' in said
