"""The notebooks run from their first cell to their last, whose assertions say what they found; and so do the examples of the documentation."""

from __future__ import annotations

import doctest
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import dscene

HERE = Path(__file__).parent
NOTEBOOKS = sorted((HERE.parent / "notebooks").glob("*.ipynb"))
NEEDS = re.compile(r"^import (jax|torch)$", re.MULTILINE)


def test_there_are_notebooks() -> None:
    assert len(NOTEBOOKS) >= 3


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run(path: Path, tmp_path: Path, optional: Callable[[str], Any]) -> None:
    nbformat, nbclient, _ = optional("nbformat"), optional("nbclient"), optional("ipykernel")
    notebook = nbformat.read(path, as_version=4)
    for module in NEEDS.findall("\n".join(cell.source for cell in notebook.cells)):
        optional(module)
    client = nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    pictures = [o for cell in notebook.cells for o in cell.get("outputs", ()) if "image/png" in o.get("data", {})]
    assert pictures, "it shows a picture"


def test_notebooks_are_kept_without_outputs() -> None:
    for path in NOTEBOOKS:
        for cell in json.loads(path.read_text())["cells"]:
            assert not cell.get("outputs"), path
            assert cell.get("execution_count") is None, path


def test_docstrings_hold() -> None:
    assert doctest.testmod(dscene).failed == 0


def test_the_readme_holds(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The first Python block of the README is run as it stands, with fewer steps."""
    readme = HERE.parent / "README.md"
    if not readme.is_file():
        pytest.skip("the repository is not here")
    monkeypatch.chdir(HERE.parents[1])
    (block,) = re.findall(r"```python\n(import dscene\nimport numpy.*?)```", readme.read_text(), re.DOTALL)
    names: dict[str, object] = {}
    exec(block.replace("range(200)", "range(12)"), names)
    script = names["s"]
    assert isinstance(script, dscene.Script)
    moved = script.eval("shadow", {"corners": names["corners"]}, seed=1)
    assert moved < 0.8 * script.eval("shadow", seed=1)
