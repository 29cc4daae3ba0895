"""Configurations: what resolves, what is refused, and in what words."""

import copy
import datetime
import math

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from support.cli_runner import CONFIGS
from support.strategies import junk, places, put, texts

from pmopt.analysis.settings import MAX_SAMPLES
from pmopt.cli.options import design_parameters, parse_edges, parse_ranges, split_pairs
from pmopt.errors import InputError
from pmopt.mechanisms import find
from pmopt.storage.checkpoint import differences
from pmopt.synthesis.checkpoint import plain
from pmopt.synthesis.config import load_config, resolve_config

MECH = "2pauu-ppap"
WHERE = "my-design.toml"
BOUNDED = ("m", "n", "l1", "l2", "c")
MODES = find(MECH).working_modes

# --- strategies ---------------------------------------------------------------------------

lengths = st.floats(1e-6, 1e6)


def ranges(low, high):
    return st.lists(st.floats(low, high), min_size=2, max_size=2, unique=True).map(sorted)


def open_ranges(low, high):
    """Return a strategy of ranges of which an end may be infinite."""
    return st.builds(
        lambda pair, left, right: [-math.inf if left else pair[0], math.inf if right else pair[1]],
        ranges(low, high), st.booleans(), st.booleans(),
    )  # fmt: skip


def some(**fields):
    """Return a strategy of dictionaries with any of the keys."""
    return st.fixed_dictionaries({}, optional=fields)


@st.composite
def workspaces(draw):
    table = draw(
        some(
            sampler=st.sampled_from(["r-sequence", "sobol", "monte-carlo"]),
            replicates=st.integers(4, 256),
            working_mode=st.sampled_from(MODES),
            norm=st.sampled_from(["2", "fro", 2]),
            jacobian=st.sampled_from(["raw", "homogenized"]),
            characteristic_length=st.floats(1e-3, 1e3),
            min_lci=st.floats(0, 1),
            regions=st.lists(st.floats(0.01, 0.99), unique=True, max_size=4).map(
                lambda inner: [0, *sorted(inner), 1]
            ),
            domain=some(x=open_ranges(-5, 5), y=open_ranges(-5, 5), z=open_ranges(-5, 5)),
            limits=some(theta1=open_ranges(-3, 3), theta2=open_ranges(-3, 3), d=open_ranges(-5, 5)),
        )
    )
    if table.get("jacobian") == "raw":
        table.pop("characteristic_length", None)
    size = draw(st.sampled_from(["default", "samples", "target_error", "grid"]))
    if size == "samples":
        table["samples"] = draw(st.integers(16, MAX_SAMPLES))
    elif size == "target_error":
        table["target_error"] = draw(st.floats(1e-6, 0.999))
    elif size == "grid":
        table = {k: v for k, v in table.items() if k not in ("sampler", "replicates")}
        table["grid"] = draw(st.integers(4, 30_000))
    return table


def bounds():
    low, high = st.floats(-10, 0), st.floats(0, 10)
    return st.one_of(
        st.builds(lambda a: {"min": a}, low),
        st.builds(lambda b: {"max": b}, high),
        st.builds(lambda a, b: {"min": a, "max": b}, low, high),
    )


configs = st.builds(
    lambda tables: {"mechanism": MECH, **tables},
    some(
        objectives=st.permutations(["volume", "gci"]),
        parameters=some(
            m=ranges(0.1, 2), n=lengths | ranges(0.1, 2), l1=lengths | ranges(0.1, 2),
            l2=lengths | ranges(0.1, 2), c=st.just(0) | lengths | ranges(0.1, 2),
            h=lengths | ranges(0.1, 2),
        ),
        workspace=workspaces(),
        algorithm=some(
            name=st.just("nsga2"), population=st.integers(4, 100_000),
            generations=st.integers(1, 1_000_000), crossover_eta=st.floats(0.1, 100),
            crossover_probability=st.floats(0, 1), mutation_eta=st.integers(1, 100),
            seed=st.integers(0, 2**63 - 1),
        ),
        constraints=some(volume=bounds(), gci=bounds()),
        final=some(target_error=st.floats(1e-6, 0.9)),
    ),
)  # fmt: skip


def refusal(data, where=WHERE):
    """Return the message of a configuration that has to be refused."""
    with pytest.raises(InputError) as caught:
        resolve_config(data, where)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert message.startswith(f"{where}: ")
    return message


# --- valid configurations -----------------------------------------------------------------


@given(configs)
@example({"mechanism": MECH})
def test_valid_configuration_resolves_and_comes_back(data):
    before = copy.deepcopy(data)
    config = resolve_config(data, WHERE)
    assert data == before
    assert resolve_config(plain(config), WHERE) == config
    document = plain(config)
    # Everything is there, and what was given stays.
    assert list(document["parameters"]) == [*BOUNDED, "h"]
    for name, value in data.get("parameters", {}).items():
        assert document["parameters"][name] == value
    for table in ("workspace", "algorithm", "final"):
        for key, value in data.get(table, {}).items():
            kept = document[table][key]
            if key in ("domain", "limits"):
                kept = {name: [float(end) for end in ends] for name, ends in kept.items()}
            assert kept == (str(value) if key == "norm" else value), (table, key)
    assert document["objectives"] == data.get("objectives", ["volume", "gci"])
    assert list(differences(document, plain(resolve_config(document, WHERE)))) == []


def test_defaults_are_completed():
    config = resolve_config({"mechanism": "2PaUU PPaP"}, WHERE)
    mechanism = find(MECH)
    assert config.mechanism == MECH
    assert config.objectives == ("volume", "gci")
    assert config.parameters == {
        "m": (0.5, 1.5), "n": (0.2, 1.0), "l1": (0.5, 1.5), "l2": (0.5, 1.5), "c": (0.1, 0.5),
        "h": None,
    }  # fmt: skip
    assert config.workspace.working_mode == mechanism.working_modes[0]
    assert config.workspace.jacobian == mechanism.default_jacobian
    assert config.adaptive
    algorithm = config.algorithm
    assert (algorithm.name, algorithm.population, algorithm.generations) == ("nsga2", 200, 200)
    assert (algorithm.crossover_eta, algorithm.mutation_eta, algorithm.seed) == (20, 20, 1)
    assert config.constraints == {}


def test_samples_are_adaptive_unless_something_is_given():
    for table in ({}, {"samples": "adaptive"}, {"samples": "adaptive", "replicates": 8}):
        config = resolve_config({"mechanism": MECH, "workspace": table}, WHERE)
        assert config.adaptive
        assert plain(config)["workspace"]["samples"] == "adaptive"
    for table in ({"samples": 5000}, {"grid": 10}, {"target_error": 0.1}):
        config = resolve_config({"mechanism": MECH, "workspace": table}, WHERE)
        assert not config.adaptive
        assert plain(config)["workspace"]["samples"] == table.get("samples")


def test_range_number_and_absence():
    config = resolve_config({"mechanism": MECH, "parameters": {"m": [1, 2], "n": 1, "h": 2}}, WHERE)
    assert config.parameters["m"] == (1.0, 2.0)
    assert config.parameters["n"] == 1.0
    assert config.parameters["l1"] == (0.5, 1.5)
    assert config.parameters["h"] == 2.0


def test_configuration_is_frozen():
    config = resolve_config({"mechanism": MECH}, WHERE)
    with pytest.raises(ValueError, match="frozen"):
        config.algorithm.seed = 2


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.toml")), ids=lambda p: p.name)
def test_shipped_configuration_loads(path):
    config = load_config(path)
    assert path.stem in ("quickstart", config.mechanism)
    assert resolve_config(plain(config), path.name) == config


def test_shipped_configurations_are_the_papers_problem():
    """Section 6.2: five dimensions with these bounds, population and generations of 200."""
    config = load_config(CONFIGS / "2pauu-ppap.toml")
    default = resolve_config({"mechanism": MECH}, WHERE)
    assert config.parameters == default.parameters
    assert (config.algorithm.population, config.algorithm.generations) == (200, 200)
    assert config.adaptive


# --- what is refused ----------------------------------------------------------------------


@settings(max_examples=400)
@given(st.data())
def test_anything_anywhere_resolves_or_is_refused_in_one_line(data):
    config = data.draw(configs)
    path = data.draw(st.sampled_from(places(config)))
    check(put(config, path, data.draw(junk)))


@given(configs, texts, junk)
def test_unknown_keys_are_refused(config, key, value):
    tables = [(), *[(k,) for k, v in config.items() if isinstance(v, dict)]]
    for path in tables:
        table = config if path == () else config[path[0]]
        if key in {**table, **dict.fromkeys(KNOWN.get(path, ()))}:
            continue
        message = refusal(put(config, (*path, key), value))
        assert any(" ".join(text.split()) in message for text in (key, repr(key)))


KNOWN = {
    (): ("mechanism", "objectives", "parameters", "workspace", "algorithm", "constraints", "final"),
    ("parameters",): (*BOUNDED, "h"),
    ("workspace",): (
        "sampler", "samples", "replicates", "grid", "target_error", "working_mode", "norm",
        "jacobian", "characteristic_length", "min_lci", "regions", "domain", "limits",
    ),
    ("algorithm",): (
        "name", "population", "generations", "crossover_eta", "crossover_probability",
        "mutation_eta", "seed", "reference",
    ),
    ("constraints",): ("volume", "gci"),
    ("final",): ("target_error",),
}  # fmt: skip


@given(configs, st.booleans() | st.just(math.nan) | st.just("1 K") | st.just([]) | st.dates())
def test_numbers_are_numbers(config, wrong):
    """Booleans, NaN, text, lists and dates stand nowhere where a number belongs."""
    numbers = [
        path for path in places(config)
        if isinstance(value := at(config, path), int | float) and not isinstance(value, bool)
    ]  # fmt: skip
    assume(numbers)
    for path in numbers:
        refusal(put(config, path, wrong))


def at(tree, path):
    for key in path:
        tree = tree[key]
    return tree


@given(configs)
def test_swapped_ranges_are_refused(config):
    pairs = [
        path for path in places(config)
        if path[0] in ("parameters", "workspace") and isinstance(at(config, path), list)
        and path[-1] != "regions"
    ]  # fmt: skip
    assume(pairs)
    for path in pairs:
        message = refusal(put(config, path, at(config, path)[::-1]))
        assert path[-1] in message
        assert "lower < upper" in message


@given(junk)
def test_what_is_no_table_is_refused(data):
    assume(not (isinstance(data, dict) and data.get("mechanism") == MECH))
    refusal(data)


def check(data):
    """Assert that a configuration resolves, or is refused in one line that names the file."""
    try:
        config = resolve_config(data, WHERE)
    except InputError as error:
        message = str(error)
        assert message.startswith(f"{WHERE}: ")
        assert len(message.splitlines()) == 1
        return
    assert config.mechanism == MECH
    assert config.algorithm.population >= 4
    for value in config.parameters.values():
        ends = value if isinstance(value, tuple) else (value, value)
        assert value is None or all(math.isfinite(end) for end in ends)


REFUSED = [
    ({"algorithm": {"generatons": 5}}, ("algorithm.generatons", "nearest: generations")),
    ({"workspce": {}}, ("workspce", "nearest: workspace")),
    ({"parameters": {"l3": 1.0}}, ("parameters", "'l3'", "m, n, l1, l2, c, h", "nearest: l")),
    ({"parameters": {"m": [1.5, 0.5]}}, ("m=[1.5, 0.5]", "lower < upper", "in m")),
    ({"parameters": {"m": [1.0, 1.0]}}, ("m=[1.0, 1.0]", "lower < upper")),
    ({"parameters": {"m": [0.5, 1.0, 1.5]}}, ("m=[0.5, 1.0, 1.5]", "[lower, upper]")),
    ({"parameters": {"m": [0, 1]}}, ("m=[0, 1]", "1e-06 to 1e+06")),
    ({"parameters": {"m": [0.5, math.inf]}}, ("m=[0.5, inf]", "1e-06 to 1e+06")),
    ({"parameters": {"m": -1}}, ("m=-1", "1e-06 to 1e+06")),
    ({"parameters": {"m": True}}, ("m=True", "number")),
    ({"parameters": {"m": 10**400}}, ("m=1000", "number")),
    ({"parameters": dict.fromkeys(BOUNDED, 0.5)}, ("parameters", "at least one needs a range")),
    ({"objectives": ["volume"]}, ("objectives", "['volume']", "volume, gci")),
    ({"objectives": ["gci", "gci"]}, ("objectives", "['gci', 'gci']")),
    (
        {"objectives": ["volume", "size"]},
        ("objectives", "'size'", "'projected_volume' or 'footprint'"),
    ),
    ({"workspace": {"samples": 15}}, ("workspace.samples=15", "16")),
    ({"workspace": {"samples": 2000.5}}, ("workspace.samples=2000.5", "integer")),
    ({"workspace": {"samples": 100, "grid": 10}}, ("workspace", "samples", "grid")),
    ({"workspace": {"samples": "adaptive", "grid": 10}}, ("workspace", "samples", "grid")),
    (
        {"workspace": {"samples": "adaptive", "target_error": 0.1}},
        ("workspace", "samples", "target_error"),
    ),
    ({"workspace": {"samples": "adaptiv"}}, ("workspace.samples='adaptiv'", "adaptive")),
    ({"workspace": {"sampler": "halton"}}, ("workspace.sampler='halton'", "sobol")),
    ({"workspace": {"working_mode": "in"}}, ("workspace.working_mode", "'in'", *MODES)),
    ({"workspace": {"regions": [0, 0.5]}}, ("regions", "[0.0, 0.5]", "from 0 to 1")),
    ({"workspace": {"regions": [0, 0.5, 0.5, 1]}}, ("regions", "ascend")),
    ({"workspace": {"domain": {"z": [1, 0]}}}, ("domain.z", "[1.0, 0.0]", "lower < upper")),
    ({"workspace": {"domain": {"w": [0, 1]}}}, ("workspace.domain", "'w'", "x, y, z")),
    ({"workspace": {"limits": {"theta": [0, 1]}}}, ("limits", "'theta'", "theta1, theta2, d")),
    ({"workspace": {"jacobian": "raw", "characteristic_length": 1.0}}, ("characteristic_length",)),
    ({"algorithm": {"population": 2}}, ("algorithm.population=2", "4")),
    ({"algorithm": {"name": "moead"}}, ("algorithm.name='moead'", "nsga2")),
    ({"algorithm": {"seed": -1}}, ("algorithm.seed=-1", "0")),
    ({"constraints": {"gci": {}}}, ("constraints.gci", "min or max")),
    ({"constraints": {"gci": {"min": 1, "max": 0}}}, ("constraints.gci", "min 1.0", "max 0.0")),
    ({"constraints": {"dexterity": {"min": 0.1}}}, ("dexterity", "volume", "gci")),
    ({"final": {"target_error": 0}}, ("final.target_error=0",)),
    ({"workspace": 5}, ("workspace=5",)),
]


@pytest.mark.parametrize(("change", "fragments"), REFUSED, ids=[str(c)[:60] for c, _ in REFUSED])
def test_refusal_names_key_value_and_what_is_allowed(change, fragments):
    message = refusal({"mechanism": MECH, **change})
    assert all(fragment in message for fragment in fragments), message


def test_mechanism_is_needed_and_known():
    assert "mechanism is missing" in refusal({})
    message = refusal({"mechanism": "3-urc"})
    assert all(text in message for text in ("'3-urc'", MECH, "nearest"))


@pytest.mark.parametrize(
    "change",
    [{"a\nb": 1}, {"workspace": {"a\nb": 1}}, {"parameters": {"m": "a\nb"}},
     {"constraints": {"a\nb": {"min": 1}}}],
)  # fmt: skip
def test_line_breaks_in_names_and_values(change):
    refusal({"mechanism": MECH, **change})


# --- files --------------------------------------------------------------------------------

BAD_FILES = {
    "torn": b'mechanism = "2pauu',
    "key twice": b'mechanism = "2pauu-ppap"\nmechanism = "2pauu-ppap"\n',
    "no text": b"\xff\xfe\x00\x01",
    "deep": b"a = " + b"[" * 50_000,
    "date": b'mechanism = "2pauu-ppap"\n[algorithm]\nseed = 2020-01-01\n',
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_bad_file(tmp_path, case):
    path = tmp_path / WHERE
    path.write_bytes(BAD_FILES[case])
    with pytest.raises(InputError) as caught:
        load_config(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("name", [".", "missing.toml", "missing/config.toml", "x" * 300])
def test_file_that_can_not_be_read(tmp_path, name):
    with pytest.raises(InputError, match=r"no such file|is a folder"):
        load_config(tmp_path / name)


@pytest.mark.parametrize("number", ["9" * 5000, "0x" + "f" * 5000])
def test_file_with_an_endless_number(tmp_path, number):
    path = tmp_path / WHERE
    path.write_text(f'mechanism = "{MECH}"\n[algorithm]\nseed = {number}\n')
    with pytest.raises(InputError):
        load_config(path)


def test_toml_gives_what_a_dictionary_gives(tmp_path):
    path = tmp_path / WHERE
    path.write_text(
        f'mechanism = "{MECH}"\n[parameters]\nm = [0.5, 1]\nh = 2\n[workspace]\nnorm = 2\n'
        "domain = {z = [0.5, inf]}\n[constraints]\ngci = {min = 0.1}\n"
    )
    data = {
        "mechanism": MECH, "parameters": {"m": [0.5, 1.0], "h": 2},
        "workspace": {"norm": "2", "domain": {"z": [0.5, math.inf]}},
        "constraints": {"gci": {"min": 0.1}},
    }  # fmt: skip
    assert load_config(path) == resolve_config(data, WHERE)


# --- differences --------------------------------------------------------------------------


@given(configs, configs)
def test_differences_are_what_differs(one, other):
    a, b = plain(resolve_config(one, WHERE)), plain(resolve_config(other, WHERE))
    assert list(differences(a, a)) == []
    found = list(differences(a, b))
    assert bool(found) == (a != b)
    assert len({name for name, _, _ in found}) == len(found)
    for name, old, new in found:
        assert (at_or_none(a, name), at_or_none(b, name)) == (old, new)
        assert old != new


def at_or_none(tree, name):
    for key in name.split("."):
        tree = tree.get(key) if isinstance(tree, dict) else None
    return tree


# --- options of the command line ----------------------------------------------------------

# What a process can be given: no argument holds a NUL.
arguments = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=30)
numbers = st.floats(allow_nan=False, allow_infinity=False)
names = st.from_regex(r"[a-z][a-z0-9_]{0,5}", fullmatch=True)
limited = st.sampled_from([c.name for c in find(MECH).limited])
pairs_text = st.lists(
    st.builds(lambda k, e, v: k + e + v, names | texts, st.sampled_from(["=", "==", "", " = "]),
              st.one_of(numbers.map(repr), texts, st.sampled_from(["nan", "inf", "1_0", "0x1"]))),
    max_size=3,
).map(",".join)  # fmt: skip
fuzz = st.lists(arguments | pairs_text | pairs_text.map("@".__add__), max_size=3)


@given(fuzz)
@example(["@"])
@example(["@" + "x" * 5000])
@example(["m=1", "m=1"])
@example(["m=" + "9" * 5000])
def test_params_are_numbers_or_refused(given_texts):
    try:
        resolved = design_parameters(find(MECH), given_texts)
    except InputError as error:
        assert "--params" in str(error)
        return
    assert all(v is None or math.isfinite(v) for v in resolved.values())
    assert set(resolved) == {p.name for p in find(MECH).parameters}


@given(fuzz)
def test_coordinates_are_numbers_or_refused(given_texts):
    mechanism = find(MECH)
    try:
        pairs = split_pairs(given_texts, "--pose")
        found = mechanism.check_coordinates(pairs, mechanism.pose, "--pose")
    except InputError as error:
        assert str(error).startswith("--pose: ")
        return
    assert all(isinstance(v, float) and math.isfinite(v) for v in found.values())


@given(st.lists(arguments | st.builds("{}={}:{}".format, names, numbers | texts, numbers | texts)))
@example(["x=inf:-inf"])
@example(["x=nan:1"])
@example(["x=1:1"])
@example(["x=0:1:2"])
def test_ranges_are_ascending_or_refused(given_texts):
    try:
        found = parse_ranges(given_texts, "--domain", find(MECH))
    except InputError as error:
        assert str(error).startswith("--domain: ")
        return
    assert all(low < high for low, high in found.values())


@given(st.dictionaries(names, numbers, min_size=1, max_size=4), st.data())
def test_pairs_come_back_however_they_are_split(values, data):
    pairs = [f"{k} = {v!r}" for k, v in values.items()]
    cut = data.draw(st.integers(0, len(pairs) - 1))
    parts = [",".join(part) for part in (pairs[:cut], pairs[cut:]) if part]
    assert {k: float(v) for k, v in split_pairs(parts, "--pose").items()} == values
    with pytest.raises(InputError, match="twice"):
        split_pairs([*parts, pairs[0]], "--pose")


@given(st.dictionaries(limited, st.tuples(numbers, numbers), min_size=1, max_size=3))
def test_ranges_come_back(values):
    values = {k: (min(v), max(v)) for k, v in values.items()}
    assume(all(low < high for low, high in values.values()))
    text = ",".join(f"{k}={low!r}:{high!r}" for k, (low, high) in values.items())
    assert parse_ranges([text], "--limits", find(MECH)) == values
    backwards = ",".join(f"{k}={high!r}:{low!r}" for k, (low, high) in values.items())
    with pytest.raises(InputError, match="LOWER < UPPER"):
        parse_ranges([backwards], "--limits", find(MECH))


@given(st.lists(numbers, min_size=1, max_size=5))
def test_edges_come_back(values):
    assert parse_edges(",".join(map(repr, values))) == tuple(values)


def test_open_ranges():
    assert parse_ranges(["x=-inf:1", "y=0:inf"], "--domain", find(MECH)) == {
        "x": (-math.inf, 1.0), "y": (0.0, math.inf),
    }  # fmt: skip


@given(st.dates())
def test_params_file_keeps_what_is_no_number_for_the_mechanism_to_refuse(tmp_path_factory, date):
    assert isinstance(date, datetime.date)
    path = tmp_path_factory.mktemp("params") / "p.toml"
    path.write_text(f"m = {date.isoformat()}\n")
    with pytest.raises(InputError, match=r"p.toml: m=\d{4}-"):
        design_parameters(find(MECH), [f"@{path}"])
