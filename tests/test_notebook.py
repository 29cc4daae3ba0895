"""The notebook that does the paper again: every assertion in its cells holds."""

import re
import shutil
from pathlib import Path

import pytest

import pmopt

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOK = ROOT / "notebooks" / "2pauu-ppap.ipynb"
CONFIG = ROOT / "configs" / "2pauu-ppap.toml"


def read(path=NOTEBOOK):
    nbformat = pytest.importorskip("nbformat")
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    return notebook


def code_cells(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def test_is_committed_without_outputs():
    notebook = read()
    assert notebook.metadata.kernelspec.name == "python3"
    cells = code_cells(notebook)
    assert cells
    for cell in cells:
        assert cell.outputs == []
        assert cell.execution_count is None
        assert "execution" not in cell.metadata  # times of the last run


def test_uses_the_public_interface_only():
    text = "\n".join(cell.source for cell in code_cells(read()))
    assert "import pmopt\n" in text
    assert not re.search(r"(from|import) pmopt\.|pmopt\.(analysis|reporting|api)\b", text)
    named = set(re.findall(r"\bpmopt\.(\w+)", text))
    assert named <= set(pmopt.__all__)


@pytest.mark.slow
def test_runs(tmp_path, monkeypatch):
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    monkeypatch.delenv("MPLBACKEND", raising=False)  # the kernel's own, which shows pictures inline
    folder = tmp_path / "notebooks"
    folder.mkdir()
    (tmp_path / "configs").mkdir()
    shutil.copy(CONFIG, tmp_path / "configs")
    notebook = read(shutil.copy(NOTEBOOK, folder))
    client = nbclient.NotebookClient(
        notebook,
        timeout=600,
        kernel_name="python3",
        resources={"metadata": {"path": str(folder)}},
    )
    client.execute()  # raises CellExecutionError at the first cell that fails
    cells = code_cells(notebook)
    assert all(cell.execution_count for cell in cells)
    outputs = [output for cell in cells for output in cell.outputs]
    assert not [output for output in outputs if output.output_type == "error"]
    pictures = [output for output in outputs if "image/png" in output.get("data", {})]
    assert len(pictures) >= 12
    # Nothing is written beside the notebook.
    assert sorted(p.name for p in tmp_path.rglob("*") if p.is_file()) == [
        "2pauu-ppap.ipynb",
        "2pauu-ppap.toml",
    ]
