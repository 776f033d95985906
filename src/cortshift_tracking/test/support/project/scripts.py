"""Programs of script/ as modules, so that their functions can be called."""
import importlib.machinery
import importlib.util
import pathlib

ROOT = pathlib.Path(__file__).resolve().parents[5]


def script(name):
    loader = importlib.machinery.SourceFileLoader(name, str(ROOT / 'script' / name))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(name, loader))
    loader.exec_module(module)
    return module
