"""Runs the tutorials that are notebooks and stores what they show, for the site:

    python scripts/run_notebooks.py

Needs the extra `notebook`. Cells' numbers, times and addresses are not kept, so that a second run changes little.
"""

import argparse
import re
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "tutorials"
PATIENCE = 300
"""Seconds that a cell may take."""


def executed(path: Path) -> Any:
    """The notebook with what its cells show.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell that fails, with its traceback.
    """
    import nbformat
    from nbclient import NotebookClient

    book = nbformat.read(path, as_version=4)
    NotebookClient(book, timeout=PATIENCE, resources={"metadata": {"path": str(path.parent)}}).execute()
    for cell in book.cells:
        cell.metadata.clear()
        if cell.cell_type == "code":
            cell.execution_count = None
            # Warp speaks of devices and caches of the machine; that is no part of a tutorial
            cell.outputs = [kept for kept in cell.outputs if kept.output_type != "stream" or not _of_machine(kept.text)]
            for output in cell.outputs:
                if "execution_count" in output:
                    output.execution_count = None
                if "text/html" in output.get("data", {}):
                    output.data.pop("text/plain", None)  # what the picture is instead of
    return book


def _of_machine(text: str) -> bool:
    return bool(re.match(r"(Warp |Module )", text))


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    return argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)


def main() -> None:
    """Runs every notebook in place."""
    import nbformat

    parser().parse_args()
    for path in sorted(FOLDER.glob("*.ipynb")):
        nbformat.write(executed(path), path)
        print(path)


if __name__ == "__main__":
    main()
