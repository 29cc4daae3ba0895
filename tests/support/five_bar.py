"""The example of a plug-in, for tests: a planar mechanism of two freedoms."""

import importlib.util
import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "plugin"
_spec = importlib.util.spec_from_file_location("five_bar", FOLDER / "five_bar.py")
_module = importlib.util.module_from_spec(_spec)
sys.modules.setdefault("five_bar", _module)
_spec.loader.exec_module(_module)
MECHANISM = _module.MECHANISM
