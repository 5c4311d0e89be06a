"""warpchain: dynamics of roller-chain drives, many variants at once, on CPU and GPU."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from warpchain import notebook_renderer

if TYPE_CHECKING:
    from warpchain.archive import read_archive, write_archive
    from warpchain.archive.options import ArchiveOptions
    from warpchain.assembly import assemble
    from warpchain.drive import Drive, dumps_drive, load_drive, loads_drive
    from warpchain.drive.laws import contact_law
    from warpchain.drive.own_loads import load_law
    from warpchain.drive.plugins import load_plugin
    from warpchain.engine.fmu import export_fmu
    from warpchain.engine.simulation import simulate
    from warpchain.engine.stepping import stepping
    from warpchain.engine.tensioner_bench import bench_tensioner
    from warpchain.errors import WarpchainError
    from warpchain.modal import Modes, modes
    from warpchain.results.engineering_report import Wear
    from warpchain.results.judgement import Limits
    from warpchain.results.own_channels import channel
    from warpchain.results.own_metrics import metric
    from warpchain.results.run import Record, Run, Trajectory
    from warpchain.study.optimize import open_study, optimize
    from warpchain.study.run import run_study
    from warpchain.view.report import report

_HOME = {
    "ArchiveOptions": "archive.options",
    "Drive": "drive",
    "Limits": "results.judgement",
    "Modes": "modal",
    "Record": "results.run",
    "Run": "results.run",
    "Trajectory": "results.run",
    "WarpchainError": "errors",
    "Wear": "results.engineering_report",
    "assemble": "assembly",
    "bench_tensioner": "engine.tensioner_bench",
    "channel": "results.own_channels",
    "contact_law": "drive.laws",
    "dumps_drive": "drive",
    "export_fmu": "engine.fmu",
    "load_drive": "drive",
    "load_law": "drive.own_loads",
    "load_plugin": "drive.plugins",
    "loads_drive": "drive",
    "metric": "results.own_metrics",
    "modes": "modal",
    "open_study": "study.optimize",
    "optimize": "study.optimize",
    "read_archive": "archive",
    "report": "view.report",
    "run_study": "study.run",
    "simulate": "engine.simulation",
    "stepping": "engine.stepping",
    "write_archive": "archive",
}

__all__ = [
    "ArchiveOptions",
    "Drive",
    "Limits",
    "Modes",
    "Record",
    "Run",
    "Trajectory",
    "WarpchainError",
    "Wear",
    "__version__",
    "assemble",
    "bench_tensioner",
    "channel",
    "contact_law",
    "dumps_drive",
    "export_fmu",
    "load_drive",
    "load_law",
    "load_plugin",
    "loads_drive",
    "metric",
    "modes",
    "open_study",
    "optimize",
    "read_archive",
    "report",
    "run_study",
    "simulate",
    "stepping",
    "write_archive",
]


def __getattr__(name: str) -> Any:
    """Imports a public name of warpchain when first used."""
    if name == "__version__":
        from warpchain.version import installed_version

        return installed_version()
    if name in _HOME:
        return getattr(import_module(f"warpchain.{_HOME[name]}"), name)
    raise AttributeError(f"module 'warpchain' has no attribute {name!r}")


def __dir__() -> list[str]:
    """Public names of warpchain, imported or not."""
    return sorted(__all__)


def _render_notebook(thing: Any) -> str:
    """HTML of a drive, run or trajectory for notebooks."""
    return str(import_module("warpchain.view.notebook").notebook_html(thing))


notebook_renderer.register_renderer(_render_notebook)
