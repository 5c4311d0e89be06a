"""Tutorials that are notebooks."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from common.cases import ROOT, Line, case


def executed_notebook(path: Path) -> Any:
    """The notebook with the outputs of its cells.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell that fails, with its traceback.
    """
    import nbformat
    from nbclient import NotebookClient

    book = nbformat.read(path, as_version=4)
    NotebookClient(book, timeout=300, resources={"metadata": {"path": str(path.parent)}}).execute()
    for cell in book.cells:
        cell.metadata.clear()
        if cell.cell_type == "code":
            cell.execution_count = None
            # Warp speaks of devices and caches of the machine; that is no part of a tutorial
            cell.outputs = [kept for kept in cell.outputs if not kept.get("text", "").startswith(("Warp ", "Module "))]
            for output in cell.outputs:
                if "execution_count" in output:
                    output.execution_count = None
                if "text/html" in output.get("data", {}):
                    output.data.pop("text/plain", None)  # what the picture is instead of
    return book


@case()
def notebooks(asked: argparse.Namespace) -> Iterator[Line]:
    """Runs the tutorials that are notebooks and stores their outputs, for the site.

    python scripts/docs.py notebooks

    Needs the extra `notebook`. Cells' numbers, times and addresses are not kept, so that a second run changes little.
    """
    import nbformat

    for path in sorted((ROOT / "docs" / "tutorials").glob("*.ipynb")):
        nbformat.write(executed_notebook(path), path)
        yield str(path)
