"""Results print in one line, show as tables, give DataFrames and axes, and are the records."""

import inspect
import json
import pickle
import subprocess
import sys
from dataclasses import fields, replace

import matplotlib as mpl
import pytest

import pmopt
from pmopt.analysis.workspace import compute
from pmopt.api.results.showing import Showing

POSE = {"x": 0.1, "y": 0.2, "z": 1.2}
BOX = {"x": (-0.1, 0.1), "y": (-0.1, 0.1), "z": (1.3, 1.5)}
SEARCH = {
    "mechanism": "2pauu-ppap",
    "objectives": ["volume", "gci"],
    "workspace": {"samples": 1024},
    "algorithm": {"population": 8, "generations": 2},
    "final": {"target_error": 0.05},
}
MOTION = {
    "trajectory": {"space": "task", "duration": 1.0, "step": 0.05, "x": "0.1*sin(t)", "y": 0.0,
                   "z": 1.2},
}  # fmt: skip


@pytest.fixture(scope="module")
def design():
    mpl.use("agg")
    return pmopt.mechanism("2PaUU PPaP").design(l1=0.8)


#: What makes each result, and what its line has.
RESULTS = {
    "ik": (lambda d: d.ik(POSE), "4 solutions, 4 within limits"),
    "fk": (lambda d: d.fk({"theta1": 0.4, "theta2": 0.1, "d": 0.2}), "2 assembly modes"),
    "jacobian": (lambda d: d.jacobian(POSE), "LCI 0.493566 (raw, 2-norm)"),
    "mobility": (lambda d: d.mobility(samples=2), "freedom 3 (3T)"),
    "workspace": (lambda d: d.workspace(samples=4096, shape_grid=0), " ± "),
    "singularities": (lambda d: d.singularities(samples=2048, grid=14), "determinants change"),
    "certify": (lambda d: d.certify(domain=BOX, min_lci=0.2, time_budget=5.0), ": proven"),
    "certify_volume": (lambda d: d.certify_volume(gap=0.3), "m^3, guaranteed"),
    "capability": (
        lambda d: d.capability(speed=1.0, samples=4096, motors={"theta1_rate": 3.0}), " % of ",
    ),
    "motion": (lambda d: d.motion(MOTION), "peak efforts: theta1"),
    "pareto": (lambda d: pmopt.pareto(SEARCH), "hypervolume"),
}  # fmt: skip


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_prints_shows_plots_and_gives_frames(name, design):
    make, words = RESULTS[name]
    result = make(design)
    line = repr(result)
    assert words in line and "\n" not in line and len(line) < 300
    assert str(result) == line
    page = result._repr_html_()
    assert page.count("<table>") == page.count("</table>") >= 1
    assert "<script" not in page
    for frame in result.frames:
        found = result.to_frame(frame)
        assert list(found.columns) and found.index.is_unique
    assert list(result.to_frame().columns) == list(result.to_frame(result.frames[0]).columns)
    with pytest.raises(pmopt.InputError, match="to_frame: unknown name 'nothing'"):
        result.to_frame("nothing")
    axes = result.plot()
    assert isinstance(axes, mpl.axes.Axes)
    assert axes.figure.number in mpl.pyplot.get_fignums()  # notebooks show it
    mpl.pyplot.close("all")
    json.dumps(result.to_dict(), allow_nan=False)


def test_a_result_is_the_record(design):
    found = design.workspace(samples=4096, shape_grid=0)
    plain = compute.compute_workspace(
        design.mechanism, design.parameters, found.settings, shape_grid=0
    )
    assert isinstance(found, compute.WorkspaceResult)
    assert found.to_dict() == plain.to_dict()
    assert all(getattr(found, f.name) == getattr(plain, f.name) for f in fields(plain))
    assert pickle.loads(pickle.dumps(found)).to_dict() == plain.to_dict()
    frame = found.to_frame().set_index("quantity")
    assert frame.loc["volume", "value"] == found.volume.value
    assert frame.loc["volume", "standard_error"] == found.volume.error
    assert frame.loc["volume", "unit"] == "m^3"
    assert found == pmopt.workspace("2pauu-ppap", {"l1": 0.8}, samples=4096, shape_grid=0)


def test_every_result_over_a_workspace_has_the_same_subject(design):
    limits = {"theta1": (-0.5, 1.5)}
    place = {"domain": BOX, "limits": limits, "working_mode": "out-out"}
    results = [
        design.workspace(samples=4096, shape_grid=0, **place),
        design.certify(box_budget=10, **place),
        design.certify_volume(box_budget=10, **place),
        design.capability(speed=1.0, samples=4096, workspace=place),
        design.singularities(samples=1024, grid=8, **place),
    ]
    first = results[0].subject
    assert isinstance(first, pmopt.Subject)
    assert all(result.subject == first for result in results)
    assert (first.mechanism, first.length_unit) == ("2pauu-ppap", "m")
    assert first.working_mode == "out-out"
    assert (first.params, first.box, first.limits) == (design.parameters, BOX, limits)
    for result in results:
        assert (result.mechanism, result.params) == (first.mechanism, first.params)
        assert (result.working_mode, result.box) == (first.working_mode, first.box)


def test_results_at_poses_have_a_subject(design):
    limits = {"theta1": (-0.5, 1.5)}
    found = design.jacobian(POSE, "out-out", limits=limits)
    subject = found.subject
    assert (subject.mechanism, subject.params) == ("2pauu-ppap", design.parameters)
    assert subject.box == {name: (value, value) for name, value in found.pose.items()}
    assert (subject.working_mode, subject.limits) == ("out-out", limits)
    assert design.ik(POSE, limits=limits).subject == replace(subject, working_mode="all")
    joints = {"theta1": 0.4, "theta2": 0.1, "d": 0.2}
    assert design.fk(joints).subject == replace(subject, working_mode="all", box={}, limits={})


def test_units_stand_beside_a_frame(design):
    run = design.motion(MOTION)
    frame = run.to_frame()
    assert len(frame) == len(run.motion.t)
    assert frame.attrs["units"]["theta1_effort"] == "N m"
    assert frame.attrs["units"]["t"] == "s"


@pytest.mark.parametrize("what", ["histogram", "sections", "surface"])
def test_pictures_of_a_workspace(what, design):
    axes = design.workspace(samples=4096, shape_grid=0).plot(what)
    assert axes.has_data()
    mpl.pyplot.close("all")


def test_drawing_leaves_the_settings_of_matplotlib_alone(design):
    before = dict(mpl.rcParams)
    design.draw(POSE, "in-in")
    assert dict(mpl.rcParams) == before
    mpl.pyplot.close("all")


def test_what_cannot_be_drawn_is_one_line(design):
    with pytest.raises(pmopt.InputError, match="motors"):
        design.capability(speed=1.0, samples=4096).plot()
    with pytest.raises(pmopt.InputError, match=r"plot: unknown .*nearest: histogram"):
        design.workspace(samples=4096, shape_grid=0).plot("histgram")
    with pytest.raises(pmopt.InputError, match=r"plot: unknown .*nearest: solution"):
        design.ik(POSE).plot(solutoin=1)
    with pytest.raises(pmopt.InputError, match=r"plot: unknown .*nearest: efforts"):
        design.motion(MOTION).plot("eforts")
    with pytest.raises(pmopt.InputError, match="solution=9 is not allowed: 0 to 3"):
        design.ik(POSE).plot(9)
    with pytest.raises(pmopt.UnreachableError):
        design.draw({"x": 9, "y": 0, "z": 1})


def test_a_motion_of_a_design(design):
    with pytest.raises(pmopt.InputError, match="parameters are those of the design"):
        design.motion({**MOTION, "parameters": {"l1": 1}})
    with pytest.raises(pmopt.InputError, match="mechanism='3-cur' is not that of the design"):
        design.motion({**MOTION, "mechanism": "3-cur"})
    same = {**MOTION, "mechanism": "2pauu-ppap", "parameters": {"l1": 0.8}}
    assert pmopt.motion(same).to_dict() == design.motion(MOTION).to_dict()


def test_a_mechanism_and_a_design_show_themselves():
    mechanism = pmopt.mechanism("3cur")
    assert repr(mechanism).startswith("<3-cur: 1T2R, ")
    assert "<table>" in mechanism._repr_html_()
    assert mechanism.working_modes and mechanism.title  # what it declares is reached
    assert "l1 = 0.8 m, " in repr(pmopt.mechanism("2pauu-ppap").design(l1="800mm"))


def test_computing_imports_neither_pandas_nor_matplotlib():
    code = (
        "import sys, pmopt\n"
        "d = pmopt.mechanism('2pauu-ppap').design()\n"
        "repr(d.workspace(samples=4096, shape_grid=0))\n"
        "repr(d.fk(dict(theta1=0.4, theta2=0.1, d=0.2)))\n"
        "print([m for m in ('pandas', 'matplotlib', 'pymoo') if m in sys.modules])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"


def test_every_result_is_exported():
    names = [getattr(pmopt, name) for name in pmopt.__all__]
    classes = Showing.__subclasses__()
    assert len(classes) == 13 and all(c in names for c in classes)
    assert {c.__name__ for c in classes} <= set(pmopt.__all__)
    assert all(getattr(pmopt, c.__name__) is c for c in classes)
    assert all(inspect.signature(c.plot).return_annotation == "Axes"
               for c in classes if c is not pmopt.BatchResult)  # fmt: skip
