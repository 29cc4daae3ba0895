"""How the modules of the package depend on one another; import-linter holds the rooms apart."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pmopt

SOURCE = Path(pmopt.__file__).parent
MODULES = {
    ".".join(("pmopt", *path.relative_to(SOURCE).with_suffix("").parts)).removesuffix(
        ".__init__"
    ): path
    for path in SOURCE.rglob("*.py")
}


def imported_by(path):
    """Return the modules of the package that one imports, at its head or within a function."""
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):  # what types alone need runs nothing
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body = [ast.Pass()]
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name if name in MODULES else node.module for name in names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found & set(MODULES)


def test_no_module_imports_itself_through_others():
    graph = {name: imported_by(path) - {name} for name, path in MODULES.items()}
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the modules
    assert graph["pmopt.cli.main"]
