"""Plug-ins: entry points of packages that are not installed."""

from pathlib import Path


def install(folder, entries):
    """Make a folder on the path a package with entry points of mechanisms.

    Parameters
    ----------
    folder : Path
    entries : dict
        Name of each entry point: what it names, and the text of its module.
    """
    info = Path(folder) / "plugged-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: plugged\nVersion: 1.0\n")
    lines = ["[pmopt.mechanisms]"]
    for name, (value, text) in entries.items():
        lines.append(f"{name} = {value}")
        if text is not None:
            (Path(folder) / f"{value.partition(':')[0]}.py").write_text(text)
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
