"""The scripts of `scripts/` as modules, for tests of what they work out."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

SCRIPTS = Path(__file__).resolve().parents[1] / "scripts"


def load_script(name: str) -> ModuleType:
    """A script by its name, its neighbors at hand as when it is run; none of them stays imported."""
    spec = importlib.util.spec_from_file_location(name, SCRIPTS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    before, path = set(sys.modules), sys.path[:]
    sys.modules[name] = module  # dataclasses look there for their types
    sys.path.insert(0, str(SCRIPTS))
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path[:] = path  # a script may change it, too
        for other in {script.stem for script in SCRIPTS.glob("*.py")} & (set(sys.modules) - before):
            del sys.modules[other]
    return module
