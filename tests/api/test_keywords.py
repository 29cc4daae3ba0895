"""Keywords of the public functions: what an analysis reads, with the types of the settings."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Literal, Union, get_args, get_origin, get_type_hints

import pytest

import pmopt
from pmopt import api
from pmopt.analysis import settings
from pmopt.analysis.settings import Range
from pmopt.analysis.sizing import actuators
from pmopt.api import keywords
from pmopt.api.keywords import Number, Point, Ranges, keywords_of
from pmopt.inputs.fields import Unit

#: Keywords of each analysis, its settings and what stands beside them.
READ = {
    keywords.WorkspaceOptions: (
        settings.WorkspaceSettings,
        {"sampling", "seed", "threads", "shape_grid", "scheduler"},
    ),
    keywords.SingularityOptions: (settings.SingularitySettings, {"sampling", "threads"}),
    keywords.SectionOptions: (settings.SectionSettings, {"threads", "resolution"}),
    keywords.CertifyOptions: (settings.ClaimSettings, set()),
    keywords.CertifyVolumeOptions: (settings.VolumeSettings, set()),
    keywords.CapabilityWorkspace: (settings.CapabilityWorkspace, set()),
    keywords.CapabilityOptions: (settings.TaskSettings, {"threads", "workspace"}),
}  # fmt: skip
#: Names of joints' rates and efforts, whose units the mechanism knows.
BY_NAME = {"motors"}
ANALYSES = (
    "ik", "fk", "jacobian", "mobility", "workspace", "singularities", "certify", "certify_volume",
    "capability", "motion", "simulate", "mjcf",
)  # fmt: skip


@pytest.mark.parametrize("options", READ, ids=lambda o: o.__name__)
def test_keywords_are_the_fields(options):
    model, beside = READ[options]
    fields = model.model_fields
    angles = {f"{name}_deg" for name in fields if Unit("rad") in fields[name].metadata}
    assert set(get_type_hints(options)) == set(fields) | beside | angles


def taken(annotation, has_unit):
    """Return the type of a keyword from that of its field."""
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return taken(args[0], has_unit)
    if origin in (Union, UnionType):
        return Union[tuple(taken(arg, has_unit) for arg in args)]  # noqa: UP007
    if annotation is float:
        return Number if has_unit else float
    if origin is Literal:
        # Beside a number that may be a text, a word is a text.
        return str if has_unit else annotation
    if origin is dict:
        assert args[0] is str and get_args(args[1])[0] == Range
        return Ranges
    if origin is tuple:
        return Point if len(args) == 3 else Sequence[taken(args[0], has_unit)]
    return annotation


@pytest.mark.parametrize("options", READ, ids=lambda o: o.__name__)
def test_types_are_those_of_the_settings(options):
    model, _ = READ[options]
    hints = get_type_hints(options)
    for name, info in model.model_fields.items():
        if name not in BY_NAME:
            has_unit = any(isinstance(m, Unit) for m in info.metadata)
            assert hints[name] == taken(info.annotation, has_unit), name


def test_sizes_of_a_task_are_keywords():
    assert set(actuators.SIZES) < set(get_type_hints(keywords.CapabilityOptions))


@pytest.mark.parametrize("name", ANALYSES)
def test_a_design_takes_what_the_function_takes(name):
    function = keywords_of(getattr(api, name).__wrapped__)
    method = keywords_of(getattr(api.Design, name).__wrapped__)
    assert set(method) == set(function) - {"mechanism", "params"}


@pytest.mark.parametrize(("call", "line"), [
    (lambda: pmopt.workspace("2pauu-ppap", sampels=64), "workspace: unknown .*nearest: samples"),
    (lambda: pmopt.workspace("2pauu-ppap", sede=2), "workspace: unknown .*nearest: seed"),
    (lambda: pmopt.certify("2pauu-ppap", min_lic=0.2), "certify: unknown .*nearest: min_lci"),
    (lambda: pmopt.certify_volume("2pauu-ppap", gaap=0.2), "certify_volume: unknown.*: gap"),
    (lambda: pmopt.singularities("2pauu-ppap", gird=9), "singularities: .*nearest: grid"),
    (lambda: pmopt.capability("2pauu-ppap", sped=1.0), "capability: .*nearest: speed"),
    (lambda: pmopt.capability("2pauu-ppap", workspace={"limts": {}}), "workspace.*limits"),
    (lambda: pmopt.jacobian("2pauu-ppap", {}, nrom="fro"), "jacobian: .*nearest: norm"),
    (lambda: pmopt.mobility("2pauu-ppap", layuot="x"), "mobility: .*nearest: layout"),
    (lambda: pmopt.ik("2pauu-ppap", {}, working_mdoe="x"), "ik: .*nearest: working_mode"),
    (lambda: pmopt.fk("2pauu-ppap", {}, naer={}), "fk: .*nearest: near"),
    (lambda: pmopt.mjcf("2pauu-ppap", stpe=0.1), "mjcf: .*nearest: step"),
    (lambda: pmopt.motion({}, frce=True), "motion: .*nearest: force"),
    (lambda: pmopt.simulate({}, thread=1), "simulate: .*nearest: threads"),
    (lambda: pmopt.pareto({}, resum=True), "pareto: .*nearest: resume"),
    (lambda: pmopt.batch([], worker=1), "batch: .*nearest: workers"),
    (lambda: pmopt.mechanism("3-curr"), "unknown .*nearest: 3-cur"),
    (lambda: pmopt.mechanism("2pauu-ppap").design(l9=0.8), "2pauu-ppap: unknown name 'l9'"),
    (lambda: pmopt.mechanism("2pauu-ppap").design(l1=-1), "2pauu-ppap: l1=-1 is not allowed"),
    (lambda: pmopt.mechanism("2pauu-ppap").design({"l1": 1}, l1=1), "l1 is given twice"),
    (lambda: pmopt.mechanism("2pauu-ppap").design().workspace(sampels=64), "nearest: samples"),
])  # fmt: skip
def test_a_misspelt_keyword_is_one_line_with_the_nearest(call, line):
    with pytest.raises(pmopt.InputError, match=line) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_a_setting_of_others_says_who_reads_what():
    with pytest.raises(pmopt.InputError, match="aspect=home is not read by singularities, which"):
        pmopt.singularities("2pauu-ppap", aspect="home")


def test_sections_read_no_samples():
    design = pmopt.mechanism("2pauu-ppap").design()
    with pytest.raises(pmopt.InputError, match="samples=64 is not read by sections"):
        design.sections(samples=64)
    with pytest.raises(pmopt.InputError, match="resolution=1 is not allowed: 2 to"):
        design.sections(resolution=1)
    assert design.sections(resolution=12)[1].lci.shape == (12, 12)
    assert design.reach({"x": 0, "y": 0, "z": 1.2})[0].distance > 0


def test_all_names_are_there_and_importing_costs_nothing():
    assert all(getattr(pmopt, name) is not None for name in pmopt.__all__)
    heavy = ("numpy", "pydantic", "numba", "pandas", "matplotlib", "pmopt.api")
    code = f"import sys, pmopt; print([m for m in {heavy!r} if m in sys.modules])"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"


# --- mypy ------------------------------------------------------------------------------------

RIGHT = """
import pmopt

paper = pmopt.mechanism("2pauu-ppap").design(l1=0.8, l2="1.1m", h=None)
limits = {"theta1": (-0.5, 1.5)}
found = paper.workspace(samples=4096, limits=limits, domain={"z": ("1.2m", 1.5)}, norm="fro")
volume: float = found.volume.value
twice: float = 2 * found.volume + found.gci
text: str = f"{found.volume} {found.volume:.3f} {found.volume.unit} {found.smallest.sign}"
exact: bool = found.volume == 0 or found.volume > volume
error_of_a_share: float = found.regions[0].share.error
quantity: pmopt.Quantity = found.volume
sampling = pmopt.Sampling.to_error(1e-4, sampler="sobol")
joints = pmopt.Limits(theta1=(-0.5, 1.5), theta2_deg=("-30", 80))
with_objects = paper.workspace(sampling=sampling, limits=joints, domain=pmopt.Limits(z=(1, 2)))
document: dict[str, object] = found.to_dict()
same: pmopt.WorkspaceResult = pmopt.workspace("2pauu-ppap", {"l1": 0.8}, target_error=1e-3, seed=2)
more = pmopt.workspace("2pauu-ppap", sampler="lines", tool=(0, 0, 0.1), cone_angle_deg=40)
mode: str = paper.ik({"x": 0, "y": 0.1, "z": "1.2m"}).solutions[0].working_mode
pose: dict[str, float] = paper.fk({"theta1": 0.1, "theta2": 0.1, "d": 0}).solutions[0].pose
lci: float = paper.jacobian({"x": 0, "y": 0, "z": 1.2}, norm="fro", kind="raw").lci
freedom: int = paper.mobility(samples=2).freedom
verdict: str = paper.certify(min_lci=0.2, domain={"z": (1.3, 1.5)}, time_budget=None).verdict
upper: float = paper.certify_volume(gap=0.1, working_mode="in-in").upper
asked = paper.capability(speed=1.0, motors={"theta1_rate": 6}, workspace={"limits": limits})
lci_there: float = float(paper.sections(resolution=20, min_lci=0.1)[0].lci[0, 0])
walls = paper.singularities(samples=4096, grid=20, threads=1).walls
run = paper.motion({"trajectory": {"space": "task"}}, force=True)
front: pmopt.ParetoRun = pmopt.pareto("config.toml", resume=True)
try:
    pmopt.simulate("motion.toml", threads=2)
except pmopt.InputError as error:
    print(error.lines)
"""
WRONG = """
pmopt.workspace("2pauu-ppap", sampels=4096)
pmopt.workspace("2pauu-ppap", samples="many")
pmopt.workspace("2pauu-ppap", sampler="sobel")
pmopt.workspace("2pauu-ppap", limits={"theta1": 0.5})
pmopt.singularities("2pauu-ppap", aspect="home")
pmopt.singularities("2pauu-ppap", sampler="lines")
pmopt.certify("2pauu-ppap", samples=4096)
pmopt.certify("2pauu-ppap", min_lic=0.2)
pmopt.certify_volume("2pauu-ppap", min_lci=0.2)
pmopt.capability("2pauu-ppap", sped=1.0)
pmopt.capability("2pauu-ppap", workspace={"grid": 10})
pmopt.ik("2pauu-ppap", {"x": 0}, working_mdoe="in-in")
pmopt.fk("2pauu-ppap", {"d": 0}, naer={})
pmopt.jacobian("2pauu-ppap", {"x": 0}, nrom="fro")
pmopt.mobility("2pauu-ppap", layuot="paper")
pmopt.mjcf("2pauu-ppap", stpe=0.1)
pmopt.motion("a.toml", frce=True)
pmopt.simulate("a.toml", thread=1)
pmopt.pareto("a.toml", resum=True)
pmopt.batch("a.toml", worker=2)
pmopt.warmup("2pauu-ppap", thread=2)
pmopt.mechanism("2pauu-ppap").desing(l1=0.8)
pmopt.wrokspace("2pauu-ppap")
paper.workspace(sampels=4096)
paper.workspace(sampling=4096)
paper.workspace(sampling=pmopt.Sampling(sampels=4096))
paper.workspace(sampling=pmopt.Sampling.to_error(1e-3, sampler="sobel"))
paper.workspace(limits=pmopt.Limits(theta1=0.5))
paper.singularities(sampels=4096)
paper.certify(sampels=4096)
paper.sections(samples=4096)
paper.capability(sped=1.0)
paper.jacobian({"x": 0}, nrom="fro")
paper.motion({}, frce=True)
found.volum
found.volume.valeu
found.volume.unti
found.regions[0].share.erorr
"""


@pytest.mark.slow
def test_mypy_finds_every_misspelt_keyword(tmp_path):
    pytest.importorskip("mypy")
    script, wrong = tmp_path / "script.py", WRONG.strip().splitlines()
    script.write_text(RIGHT + "\n".join(wrong) + "\n")
    root = Path(__file__).resolve().parents[2]
    ran = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--config-file", str(root / "pyproject.toml"),
         "--no-error-summary", "--cache-dir", str(root / ".mypy_cache"), str(script)],
        capture_output=True, text=True, check=False, cwd=root,
    )  # fmt: skip
    assert not ran.stderr, ran.stderr
    first = RIGHT.count("\n") + 1
    lines = {int(line.split(":")[1]) for line in ran.stdout.splitlines()
             if line.startswith(str(script)) and ": error:" in line}  # fmt: skip
    missed = [text for n, text in enumerate(wrong, start=first) if n not in lines]
    assert not missed
    assert min(lines) >= first, ran.stdout  # what is right has no error
