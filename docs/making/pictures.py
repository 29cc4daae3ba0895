"""The pictures of the documents."""

from __future__ import annotations

import functools
import io
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

from making.pages import IMAGES, ROOT, Finding, Page, Picture, Statement, documents, links, table
from making.registry import add, maker
from making.words import run_folder
from pmopt.mechanisms import names
from pmopt.storage.files import write_atomic

#: How much a picture may differ, in shades of 255 after blurring: fonts are drawn a little
#: differently by other versions of what draws them.
SHADES = 24
_BLUR = 3


@dataclass(frozen=True)
class Recipe:
    """How a picture is made: a command, and its file in the run's folder."""

    picture: str
    command: str
    file: str = ""


RECIPES = (
    Recipe("workspace.png", "workspace 2pauu-ppap", "workspace.png"),
    *(Recipe(f"{name}.png", f"draw {name} --out {{}}.png") for name in sorted(names())),
    *(
        Recipe(f"{name}-loci.png", f"singularities {name}", "sections.png")
        for name in sorted(names())
        if name != "2pauu-ppap"
    ),
    Recipe("motion-efforts.png", "motion configs/motion/2uu-upu-t1.toml", "efforts.png"),
    Recipe(
        "motion.gif",
        "motion configs/motion/2pauu-ppap-pick-and-place.toml --animate {}.gif --fps 10",
    ),
    Recipe("simulate.png", "simulate configs/motion/2uu-upu-t1.toml", "simulate.png"),
    Recipe(
        "capability.png",
        "capability 2pauu-ppap --payload 2 --speed 1 --acceleration 10 "
        "--motors theta1_effort=300,theta2_effort=300,theta1_rate=6,theta2_rate=6",
        "capability.png",
    ),
)
#: Pictures that are made otherwise, and by what.
OTHERS = {
    "front.png": "`pmopt pareto configs/2pauu-ppap.toml`, with the figures of that front",
    "floor.png": "the last picture of `notebooks/2pauu-ppap.ipynb`",
    "scaling-samples.png": "`python benchmarks/scaling.py --out docs/images`: measures times",
    "scaling-designs.png": "`python benchmarks/scaling.py --out docs/images`: measures times",
}


def _make(recipe: Recipe) -> Iterator[Statement]:
    with run_folder(*recipe.command.split(), "--quiet") as folder:
        suffix = Path(recipe.picture).suffix
        file = folder / recipe.file if recipe.file else folder.with_suffix(suffix)
        yield Picture(recipe.picture, file.read_bytes())


def add_pictures() -> None:
    """Register a maker for each picture that a command draws."""
    for recipe in RECIPES:
        name = f"picture-{recipe.picture}"
        about = f"{IMAGES}/{recipe.picture}: pmopt {recipe.command}"
        add(name, functools.partial(_make, recipe), about)


@maker("picture-floor.png", slow=True)
def floor() -> Iterator[Statement]:
    """Run the notebook and yield its last picture."""
    import base64

    import nbclient
    import nbformat

    with tempfile.TemporaryDirectory() as name:
        shutil.copytree(ROOT / "configs", Path(name) / "configs")
        notebook = nbformat.read(ROOT / "notebooks" / "2pauu-ppap.ipynb", as_version=4)
        client = nbclient.NotebookClient(
            notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": name}}
        )
        client.execute()
    outputs = [o for cell in notebook.cells for o in cell.get("outputs", [])]
    shown = [o.data["image/png"] for o in outputs if "image/png" in o.get("data", {})]
    yield Picture("floor.png", base64.b64decode(shown[-1]))


@maker("pictures")
def all_pictures() -> Iterator[Statement | Finding]:
    """Check that all pictures of documents are there and made here, and list how."""
    made = {r.picture for r in RECIPES} | set(OTHERS)
    used = set()
    for path in documents():
        page = Page.read(path)
        for line, target in links(page):
            place = (ROOT / path).parent / target
            if not place.exists():
                yield Finding(path, line, target, "no such file")
            if place.resolve().parent == ROOT / IMAGES and place.suffix != ".md":
                used.add(place.name)
                if place.name not in made:
                    yield Finding(path, line, target, "made by nothing in docs/making/pictures.py")
    kept = {p.name for p in (ROOT / IMAGES).iterdir() if p.suffix != ".md"}
    for name in sorted(made - kept):
        yield Finding(f"{IMAGES}/{name}", 1, "nothing", "a picture that is missing")
    for name in sorted((kept | made) - used):
        yield Finding(f"{IMAGES}/{name}", 1, "a picture", "shown by no document")
    rows = [(f"`{r.picture}`", f"`pmopt {r.command.replace('{}', 'PLACE')}`"
             + (f": `{r.file}`" if r.file else "")) for r in RECIPES]  # fmt: skip
    rows += [(f"`{name}`", how) for name, how in OTHERS.items()]
    yield table(f"{IMAGES}/README.md", "pictures", ("picture", "made by"), sorted(rows))


def compare(picture: Picture, write: bool) -> list[Finding]:
    """Return whether a kept picture shows something else, and replace it if asked to."""
    path = ROOT / IMAGES / picture.name
    place = f"{IMAGES}/{picture.name}"
    if path.is_file() and path.read_bytes() == picture.data:
        return []
    if not path.is_file():
        found = [Finding(place, 1, "nothing", "a picture", mended=True)]
    else:
        apart = difference(path.read_bytes(), picture.data)
        now = f"another one ({apart})"
        found = [Finding(place, 1, "an older picture", now, mended=True)] if apart else []
    if write and found:
        write_atomic(path, picture.data)
    return found


def difference(kept: bytes, new: bytes) -> str:
    """Return in words how much two pictures differ; empty where they look alike."""
    with Image.open(io.BytesIO(kept)) as one, Image.open(io.BytesIO(new)) as two:
        frames = getattr(one, "n_frames", 1), getattr(two, "n_frames", 1)
        if one.size != two.size or frames[0] != frames[1]:
            return f"{one.size} and {two.size} dots, {frames[0]} and {frames[1]} frames"
        worst = 0
        for frame in range(frames[0]):
            one.seek(frame)
            two.seek(frame)
            a, b = (
                np.asarray(i.convert("RGB").filter(ImageFilter.BoxBlur(_BLUR)), dtype=int)
                for i in (one, two)
            )
            worst = max(worst, int(np.abs(a - b).max()))
    return f"by {worst} of 255 shades" if worst > SHADES else ""
