"""What any command is given, and how it has to end whatever that is.

A property is a strategy of command lines, made in a folder of their own, and :func:`ends_well`.
"""

import contextlib
import json
import math
import re
import signal
import tempfile
from pathlib import Path

from hypothesis import strategies as st

from pmopt.mechanisms import find, names
from support.cli_runner import here, strict_json

HANG = 60  # s; nothing that is drawn here takes a tenth of it
EXITS = {0: "success", 2: "bad input", 3: "nothing feasible"}
NOT_A_NUMBER = re.compile(r"(?i)(?<![\w-])[+-]?(nan|inf|infinity)(?![\w.-])")


class Hung(BaseException):
    """A command took longer than any should."""


@contextlib.contextmanager
def folder():
    """Give a folder of its own to one example."""
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


@contextlib.contextmanager
def nothing_drawn():
    """Leave out the pictures, which take a thousand times longer than what is drawn here."""
    from pmopt.reporting.pictures import motion_plots
    from pmopt.reporting.runs import run_pictures

    def nothing(*_):
        return {}

    kept = run_pictures.of_workspace, run_pictures.of_pareto, motion_plots.draw_motion
    run_pictures.of_workspace = run_pictures.of_pareto = motion_plots.draw_motion = nothing
    try:
        yield
    finally:
        run_pictures.of_workspace, run_pictures.of_pareto, motion_plots.draw_motion = kept


def run(words, cwd):
    """Run a command in this process; one that hangs raises."""

    def hung(*_):
        raise Hung(words)

    before = signal.signal(signal.SIGALRM, hung)
    signal.setitimer(signal.ITIMER_REAL, HANG)
    try:
        return here(*words, cwd=cwd)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def ends_well(result, cwd=None, may_write=()):
    """Check an answer: success or one clear line, and nothing left that should not be.

    Parameters
    ----------
    result : subprocess.CompletedProcess
    cwd : Path, optional
        Where it ran, its files and what was there before.
    may_write : sequence of str
        Files and folders there: the inputs and the run's folder.

    Returns
    -------
    str
        What the exit code says.
    """
    assert result.returncode in EXITS, (result.returncode, result.args, result.stderr)
    assert "Traceback" not in result.stderr, result.stderr
    said = [line for line in result.stderr.splitlines() if line.startswith("error:")]
    assert len(said) == (result.returncode != 0), (result.args, result.stderr)
    if said:
        assert "unexpected" not in said[0], (result.args, said[0])
        assert result.stderr.rstrip().endswith(said[0]), (result.args, result.stderr)
        assert len(said[0]) > len("error: ") + 10, (result.args, said[0])
    if result.stdout.lstrip().startswith(("{", "[")):
        strict_json(result.stdout)
    assert not NOT_A_NUMBER.search(result.stdout), (result.args, result.stdout)
    if cwd is not None:
        for path in cwd.rglob("*"):
            assert not path.name.endswith(".pmopt-tmp"), path
            top = path.relative_to(cwd).parts[0]
            assert top in may_write, (result.args, path)
            given = top in ("input.toml", "input.csv") or path.parent.name == "checkpoint"
            given |= path.name == "recording.csv"  # the input, as it was
            if path.is_file() and not given:
                check_file(path)
    return EXITS[result.returncode]


def check_file(path):
    """Check that a file of a run holds no NaN and is whole."""
    if path.suffix == ".json":
        strict_json(path.read_text(encoding="utf-8"))
    if path.suffix == ".csv":
        text = path.read_text(encoding="utf-8")
        assert text.endswith("\n")
        assert not NOT_A_NUMBER.search(text), (path, text[:2000])


# --- values ---------------------------------------------------------------------------------

#: What stands where a number should.
ODD_NUMBERS = st.sampled_from(
    ["nan", "inf", "-inf", "1e999", "-1", "0", "-0.0", "1e-320", "5e-324", "1e308", "-1e308",
     "1e30", "0x10", "1_0", "\uff11", "", " ", "true", "None", "1,2", "--1", "1e", "1e5e5",
     "½", "1 2",
     "9" * 400, "\x00", "\n", "=", "=1", "1=1", "@", "@no.toml", "[1]", "1:2"]
)  # fmt: skip
WORDS = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)


def mostly(good, *odd, times=12):
    """Return mostly what one strategy gives."""
    return st.integers(0, times).flatmap(lambda n: st.one_of(*odd) if n == 0 else good)


def numbers(good=None):
    """Return texts of numbers, most of them good and some anything."""
    good = st.floats(-2, 2) if good is None else good
    return mostly(good.map(repr), st.floats().map(repr), ODD_NUMBERS, WORDS)


def near(value, by):
    """Return numbers around one."""
    return st.floats(value - by, value + by)


def named(good):
    """Return ``name=value,..`` texts of good numbers by name, now and then odd ones or others."""
    known = list(good)
    some = st.lists(st.tuples(st.sampled_from(known) | WORDS, numbers()), max_size=len(known) + 1)
    full = st.tuples(*map(numbers, good.values())).map(
        lambda values: list(zip(known, values, strict=True))
    )
    return mostly(full, some).map(lambda each: ",".join(f"{k}={v}" for k, v in each))


@st.composite
def designs(draw, mechanism):
    """Return ``name=value,..`` texts of some parameters."""
    unset = [p.name for p in mechanism.parameters if p.default is None]
    some = st.sampled_from([p for p in mechanism.parameters if p.name not in unset])
    chosen = draw(st.lists(some, min_size=1, max_size=4, unique_by=lambda p: p.name))
    good = {p.name: near(p.default, 0.3 * abs(p.default)) for p in chosen}
    wild = st.floats(1e-12, 1e12)
    return draw(named({k: mostly(v, wild, times=5) for k, v in good.items()}))


def mechanisms(wide):
    """Return names of mechanisms; the first alone where kernels would take long to compile."""
    return st.sampled_from(names() if wide else ["2pauu-ppap"])


def unit_of_length(mechanism):
    """Return what dimensions of the mechanism are about."""
    return 100.0 if mechanism.length_unit == "mm" else 1.0


FORMS = st.sampled_from([(), ("--format", "json"), ("--format", "csv")])


@st.composite
def pose_commands(draw, wide=True):
    """Return ``ik``, ``fk`` and ``jacobian`` lines, and the text of ``input.csv``."""
    mechanism = find(draw(mechanisms(True)))
    scale = unit_of_length(mechanism)
    command = draw(st.sampled_from(["ik", "fk", "jacobian"]))
    coordinates = [c.name for c in (mechanism.joints if command == "fk" else mechanism.pose)]
    option = "--joints" if command == "fk" else "--pose"
    words, table = [command, mechanism.name], None
    home = mechanism.home(mechanism.resolve({}))
    if command == "fk":
        joints = mechanism.inverse(mechanism.resolve({}), home)[0].joints
        good = {k: near(joints[k], 0.1 * scale_of(joints[k], scale)) for k in coordinates}
    else:
        good = {k: near(home[k], 0.1 * scale_of(home[k], scale)) for k in coordinates}
    if command != "jacobian" and draw(st.integers(0, 2)) == 0:
        words += ["--joints-file" if command == "fk" else "--poses", "input.csv"]
        table = draw(csv_texts(good))
    else:
        words += [option, draw(named(good))]
    if draw(st.integers(0, 2)) == 0:
        words += ["--params", draw(designs(mechanism))]
    if command != "fk" and draw(st.integers(0, 3)) == 0:
        modes = [*mechanism.working_modes, "all", "OUT-OUT"]
        words += ["--working-mode", draw(mostly(st.sampled_from(modes), WORDS))]
    if command == "ik" and draw(st.integers(0, 3)) == 0:
        words += ["--limits", draw(ranges([c.name for c in mechanism.limited], scale))]
    if command == "jacobian" and draw(st.integers(0, 2)) == 0:
        words += draw(jacobian_options())
    return [*words, *draw(FORMS)], table


def scale_of(value, scale):
    """Return how far a coordinate is moved: angles are small, lengths are not."""
    return scale if abs(value) > 10 else 1.0


def ranges(known, scale=1.0):
    """Return ``name=lower:upper,..`` texts."""
    low = mostly(st.floats(-3 * scale, 0).map(repr), numbers(), st.just("-inf"))
    high = mostly(st.floats(0, 3 * scale).map(repr), numbers(), st.just("inf"))
    pair = st.tuples(mostly(st.sampled_from(list(known)), WORDS), low, high)
    return st.lists(pair, min_size=1, max_size=3, unique_by=lambda pair: pair[0]).map(
        lambda each: ",".join(f"{name}={low}:{high}" for name, low, high in each)
    )


def jacobian_options():
    """Return options of the index."""
    return st.one_of(
        st.sampled_from(["raw", "homogenized", "other"]).map(lambda v: ["--jacobian", v]),
        (numbers(st.floats(0.01, 10)) | st.just("optimal")).map(
            lambda v: ["--characteristic-length", v]
        ),
        st.sampled_from(["2", "fro", "1"]).map(lambda v: ["--norm", v]),
    )


@st.composite
def csv_texts(draw, good):
    """Return bytes of a table of coordinates, most of them well formed."""
    head = list(draw(st.permutations(list(good))))
    cells = [numbers(good[name]) if draw(st.booleans()) else good[name].map(repr) for name in head]
    if draw(st.integers(0, 5)) == 0:
        odd = st.sampled_from([*head, *(f"{c}_deg" for c in head)]) | WORDS
        head = draw(st.lists(odd, min_size=len(head), max_size=len(head)))
    rows = draw(st.lists(st.tuples(*cells), max_size=4))
    lines = [",".join(head), *(",".join(row) for row in rows)]
    raw = draw(st.sampled_from(["\n", "\r\n", "\r"])).join(lines).encode()
    return draw(mangled(raw)) if draw(st.integers(0, 5)) == 0 else raw


@st.composite
def mangled(draw, raw):
    """Return bytes with some of them cut, changed, doubled or put in."""
    raw = bytearray(raw)
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, max(len(raw) - 1, 0)))
        how = draw(st.sampled_from(["cut", "flip", "insert", "drop", "double"]))
        if how == "cut":
            del raw[place:]
        elif how == "flip" and raw:
            raw[place] ^= 1 << draw(st.integers(0, 7))
        elif how == "insert":
            raw[place:place] = draw(st.binary(min_size=1, max_size=4))
        elif how == "drop":
            del raw[place : place + draw(st.integers(1, 40))]
        elif how == "double":
            raw[place:place] = raw[place : place + 40]
    return bytes(raw)


# --- workspaces -----------------------------------------------------------------------------

OUT = st.sampled_from(["run", "run/", "./run", "run/of/mine", "run/../run", "input.csv", "."])


@st.composite
def workspace_commands(draw, wide=True):
    """Return lines of ``workspace`` that take milliseconds."""
    mechanism = find(draw(mechanisms(wide)))
    scale = unit_of_length(mechanism)
    words = ["workspace", mechanism.name, "--shape-grid"]
    words.append(draw(mostly(st.sampled_from(["0", "0", "4", "5"]), st.sampled_from("-x"))))
    size = st.one_of(
        st.integers(16, 3000).map(lambda n: ["--samples", str(n)]),
        st.integers(4, 8).map(lambda n: ["--grid", str(n)]),
        st.sampled_from(["0.3", "0.5"]).map(lambda x: ["--target-error", x]),
        st.tuples(
            st.sampled_from(["--samples", "--grid", "--target-error"]),
            st.sampled_from(["-1", "0", "3", "1", "1e3", "nan", "1.5", "1e300", ""]),
        ).map(list),
    )
    words += draw(size)
    lengths = numbers(st.floats(0.01 * scale, 0.2 * scale))
    options = [
        st.sampled_from(["r-sequence", "sobol", "monte-carlo", "lines", "grid"]).map(
            lambda v: ["--sampler", v]
        ),
        st.integers(3, 40).map(lambda n: ["--replicates", str(n)]),
        designs(mechanism).map(lambda v: ["--params", v]),
        designs(mechanism).map(lambda v: ["--params", v]),
        ranges([c.name for c in mechanism.pose], scale).map(lambda v: ["--domain", v]),
        numbers(st.floats(0, 0.6)).map(lambda v: ["--min-lci", v]),
        mostly(st.sampled_from(["0,1", "0,0.5,1", "1,0", "0,0,1"]), WORDS).map(
            lambda v: ["--regions", v]
        ),
        mostly(st.sampled_from([*mechanism.working_modes]), WORDS).map(
            lambda v: ["--working-mode", v]
        ),
        mostly(st.integers(-1, 2**63).map(str), WORDS).map(lambda v: ["--seed", v]),
        st.sampled_from(["0", "1", "2", "2", "x", "5000"]).map(lambda v: ["--threads", v]),
        (numbers(st.floats(0.01, 10)) | st.just("optimal")).map(
            lambda v: ["--characteristic-length", v]
        ),
        st.sampled_from([[], ["--dry-run"], ["--resume"], ["--force"], ["--quiet"]]),
    ]
    if wide:
        options += [
            ranges([c.name for c in mechanism.limited], scale).map(lambda v: ["--limits", v]),
            jacobian_options(),
            lengths.map(lambda v: ["--link-diameter", v]),
            lengths.map(lambda v: ["--cone-angle", v]),
            mostly(st.just(3), st.integers(2, 4))
            .flatmap(lambda n: st.tuples(*[lengths] * n))
            .map(lambda v: ["--tool", ",".join(v)]),
            st.just(["--aspect", "home"]),
            st.sampled_from(["translational", "rotational"]).map(lambda v: ["--block", v]),
        ]
    for option in draw(st.lists(st.sampled_from(options), max_size=3, unique_by=id)):
        words += draw(option)
    if draw(st.integers(0, 19)) == 0:
        words += ["--out", draw(OUT)]
    return [*words, *draw(FORMS)]


# --- configurations -------------------------------------------------------------------------

ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | WORDS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=6,
)


def to_toml(document):
    """Return TOML of a dictionary; what TOML does not have (None) is left out."""

    def value(item):
        if isinstance(item, bool):
            return str(item).lower()
        if isinstance(item, float):
            return repr(item) if math.isfinite(item) else str(item)
        if isinstance(item, str):
            return json.dumps(item).replace("\x7f", "\\u007f")
        if isinstance(item, list | tuple):
            return "[" + ", ".join(value(i) for i in item if i is not None) + "]"
        if isinstance(item, dict):
            parts = (f"{value(str(k))} = {value(v)}" for k, v in item.items() if v is not None)
            return "{" + ", ".join(parts) + "}"
        return str(item)

    return "".join(f"{value(str(k))} = {value(v)}\n" for k, v in document.items() if v is not None)


@st.composite
def search_configs(draw, wide=True):
    """Return bytes of configurations of searches that take milliseconds, some of them broken."""
    mechanism = find(draw(mechanisms(wide)))
    scale = unit_of_length(mechanism)
    bounded = [p for p in mechanism.parameters if p.bounds is not None]
    document = {
        "mechanism": mechanism.name,
        "objectives": draw(st.sampled_from(
            [["volume", "gci"], ["gci", "volume"], ["volume"], ["gci", "gci"], []]
            + ([["volume", "projected_volume"], ["gci", "footprint", "volume"]] if wide else [])
        )),
        "parameters": {p.name: list(p.bounds) for p in bounded},
        "workspace": {"samples": draw(st.integers(16, 400))},
        "algorithm": {"population": draw(st.integers(4, 8)), "generations": draw(
            st.integers(1, 3))},
        "constraints": {},
        "final": {"target_error": draw(st.floats(0.1, 0.9))},
    }  # fmt: skip
    if draw(st.integers(0, 3)):
        document["objectives"] = ["volume", "gci"]
    small = st.floats(0, 2 * scale) | st.floats(1e-9, 1e9) | st.floats()
    for p in draw(st.lists(st.sampled_from(bounded), max_size=3)):
        document["parameters"][p.name] = draw(
            small | st.tuples(small, small).map(lambda two: sorted(two, key=str)) | ANYTHING
        )
    if draw(st.integers(0, 2)) == 0:
        document["constraints"] = {
            draw(st.sampled_from(["gci", "volume"])): {draw(st.sampled_from(["min", "max"])): draw(
                small)}
        }  # fmt: skip
    if draw(st.integers(0, 2)) == 0:
        key = draw(st.sampled_from(["sampler", "min_lci", "regions", "domain", "working_mode",
                                    "grid", "target_error", "replicates"]))  # fmt: skip
        good = {
            "sampler": st.sampled_from(["sobol", "lines", "monte-carlo"]),
            "min_lci": st.floats(0, 1), "regions": st.just([0, 0.5, 1]),
            "domain": st.dictionaries(st.sampled_from([c.name for c in mechanism.pose]),
                                      st.tuples(small, small)),
            "working_mode": st.sampled_from(list(mechanism.working_modes)),
            "grid": st.integers(3, 6), "target_error": st.floats(0.2, 1),
            "replicates": st.integers(3, 20),
        }[key]  # fmt: skip
        document["workspace"][key] = draw(good)
        if key in ("grid", "target_error") and draw(st.booleans()):
            del document["workspace"]["samples"]
    if draw(st.integers(0, 3)) == 0:
        place = draw(st.sampled_from([document, *(v for v in document.values() if isinstance(
            v, dict))]))  # fmt: skip
        key = draw(st.sampled_from(sorted(place) or ["x"]) | WORDS)
        if key not in ("samples", "grid", "target_error", "population", "generations", "workspace",
                       "algorithm"):  # what is right there may take hours  # fmt: skip
            place[key] = draw(ANYTHING)
    raw = to_toml(document).encode()
    return draw(mangled(raw)) if draw(st.integers(0, 7)) == 0 else raw


# --- motions --------------------------------------------------------------------------------

FORMULAS = st.sampled_from([
    "0.1*sin(t)", "0.2 - 0.1*cos(2*t)", "rad(20)*t", "t", "sqrt(t)", "1/t", "log(t - 1)", "t**-1",
    "exp(99*t)", "t**0.5", "2**t", "sin", "sin(t", "t.real", "__import__('os')", "x", "asin(2*t)",
    "(1).__class__", "lambda: 1", "t if t else 1", "[t]", "9**9**9", "1e999", "sin(t, t)", "-t",
    "t t", "", "(" * 200 + "t" + ")" * 200, "t" + "+t" * 900,
])  # fmt: skip


@st.composite
def motion_configs(draw, wide=True):
    """Return bytes of configurations of short motions, and of ``input.csv`` or None."""
    mechanism = find(draw(mechanisms(wide)))
    home = mechanism.home(mechanism.resolve({}))
    space = draw(mostly(st.just("task"), st.sampled_from(["joint", "else"])))
    start = home if space == "task" else mechanism.inverse(mechanism.resolve({}), home)[0].joints
    by = {k: 0.05 * (100.0 if abs(v) > 10 else 1.0) for k, v in start.items()}
    good = {k: near(v, by[k]) for k, v in start.items()}
    kind = draw(st.sampled_from(["expressions", "waypoints", "gate", "file", "fit"]))
    step = mostly(st.just(0.05), st.sampled_from([0.1, 0.5, -1, 0, 1e-9, 1e9]))
    trajectory = {"space": space, "step": draw(step)}
    table = None
    if kind == "expressions":
        trajectory["duration"] = draw(st.sampled_from([1.0, 0.5, 0.0, 1e12]) | st.just(1.0))
        for k, v in start.items():
            trajectory[k] = draw(mostly(
                good[k].map(lambda g, v=v: f"{v!r} + {g - v!r}*sin(3*t)"), FORMULAS, good[k], WORDS,
                times=8,
            ))  # fmt: skip
    elif kind == "waypoints":
        row = st.fixed_dictionaries(good) | st.tuples(*good.values()).map(list)
        trajectory["waypoints"] = draw(st.lists(mostly(row, ANYTHING), min_size=1, max_size=4))
        trajectory["duration"] = 1.0
        for key, value in {
            "law": st.sampled_from(["trapezoidal", "quintic", "cubic"]), "through": st.booleans(),
            "blend": st.floats(-0.1, 0.7), "dwell": st.floats(0, 2),
            "max_rate": st.just(dict.fromkeys(start, 0.3)),
        }.items():  # fmt: skip
            if draw(st.integers(0, 3)) == 0:
                trajectory[key] = draw(value)
    elif kind == "gate":
        trajectory["gate"] = {
            "pick": draw(st.fixed_dictionaries(good)), "place": draw(st.fixed_dictionaries(good)),
            "up": draw(mostly(st.sampled_from(list(start)), WORDS)),
            "height": draw(mostly(st.floats(-0.1, 0.1), st.floats())),
            "radius": draw(mostly(st.floats(0.001, 0.05), st.floats())),
            "cycle": draw(mostly(st.floats(0.5, 2), st.floats())),
        }  # fmt: skip
    else:
        trajectory["file"] = draw(mostly(st.just("input.csv"), WORDS, st.just("../input.csv")))
        count = draw(st.integers(0, 12))
        times = [repr(0.1 * k) for k in range(count)]
        if draw(st.integers(0, 4)) == 0 and count:
            times[draw(st.integers(0, count - 1))] = draw(numbers())
        rows = [",".join([t, *(repr(draw(good[k])) if draw(st.integers(0, 30)) else draw(numbers())
                               for k in start)]) for t in times]  # fmt: skip
        raw = "\n".join([",".join(["t", *start]), *rows, ""]).encode()
        table = draw(mangled(raw)) if draw(st.integers(0, 4)) == 0 else raw
        if kind == "fit":
            trajectory["fit"] = draw(st.sampled_from([
                {"kind": "harmonics", "count": 1, "period": 1.0}, {"kind": "harmonics"},
                {"kind": "spline", "pieces": 2}, {"kind": "spline", "pieces": 99}, {"kind": "x"},
                {"kind": "harmonics", "count": 40, "period": "free"},
            ]))  # fmt: skip
    document = {"mechanism": mechanism.name, "trajectory": trajectory}
    if draw(st.integers(0, 2)) == 0:
        document["parameters"] = {p.name: draw(near(p.default, 0.3 * abs(p.default)) | st.floats())
                                  for p in mechanism.parameters[:2]}  # fmt: skip
    if draw(st.integers(0, 2)) == 0:
        size = st.floats(0, 10) | st.floats()
        document["payload"] = {"mass": draw(size), "centre": [draw(size), 0.0, 0.0]}
    if draw(st.integers(0, 2)) == 0:
        body = draw(st.sampled_from(["platform", "limb 1 link", "extra"]))
        shape = {"rod": {"diameter": draw(st.floats()), "length": 0.3}}
        document["bodies"] = {body: draw(mostly(st.just(shape), ANYTHING, times=2))}
    if draw(st.integers(0, 2)) == 0:
        joint = mechanism.joints[0].name
        key = draw(st.sampled_from([joint, f"{joint}_rate", f"{joint}_effort", "x_effort"]))
        document["limits"] = {key: sorted([draw(st.floats(-9, 9)), draw(st.floats(-9, 9))])}
    if draw(st.integers(0, 4)) == 0:
        document[draw(WORDS | st.sampled_from(["gravity", "efforts", "controller"]))] = draw(
            ANYTHING
        )
    raw = to_toml(document).encode()
    return (draw(mangled(raw)) if draw(st.integers(0, 7)) == 0 else raw), table


@st.composite
def capability_commands(draw, wide=True):
    """Return lines of ``capability`` that take milliseconds."""
    mechanism = find(draw(mechanisms(wide)))
    words = [
        "capability",
        mechanism.name,
        "--samples",
        draw(st.sampled_from(["16", "2000", "0", "x"])),
    ]
    limits = [f"{c.name}_{what}" for c in mechanism.joints for what in ("rate", "effort")]
    options = [
        *(numbers(st.floats(0, 5)).map(lambda v, name=name: [f"--{name}", v])
          for name in ("speed", "turn", "acceleration", "tool-force", "payload")),
        named({limits[0]: st.floats(0.1, 100), limits[1]: st.floats(1, 1e4)}).map(
            lambda v: ["--motors", v]
        ),
        designs(mechanism).map(lambda v: ["--params", v]),
        ranges([c.name for c in mechanism.pose], unit_of_length(mechanism)).map(
            lambda v: ["--domain", v]
        ),
        mostly(st.just("0,0,0.1"), WORDS).map(lambda v: ["--payload-centre", v]),
    ]  # fmt: skip
    for option in draw(st.lists(st.sampled_from(options), max_size=4, unique_by=id)):
        words += draw(option)
    return [*words, *draw(FORMS)]
