"""The scripts of `scripts/` as modules, for tests of what they work out."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

SCRIPTS = Path(__file__).resolve().parents[1] / "scripts"


def load_script(name: str) -> ModuleType:
    """A script, or `folder.module` of a case, its neighbors at hand as when it is run; none of them stays imported."""
    before, path = set(sys.modules), sys.path[:]
    sys.path.insert(0, str(SCRIPTS))
    try:
        if "." in name:
            return importlib.import_module(name)
        spec = importlib.util.spec_from_file_location(name, SCRIPTS / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module  # dataclasses look there for their types
        spec.loader.exec_module(module)
        return module
    finally:
        sys.path[:] = path  # a script may change it, too
        ours = {entry.stem for entry in SCRIPTS.iterdir()}
        for other in {found for found in set(sys.modules) - before if found.partition(".")[0] in ours - {name}}:
            del sys.modules[other]
