"""Settings: each analysis refuses those that it does not read, and says what reads them."""

import pytest
from support.cli_runner import error_line, here

from pmopt import api
from pmopt.analysis.certification.claim import READS as CLAIM_READS
from pmopt.analysis.certification.volume import READS as VOLUME_READS
from pmopt.analysis.kinematics.index_units import entry_units, index_note, mixes_units
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.singularities import survey
from pmopt.analysis.sizing import actuators
from pmopt.analysis.workspace.compute import check_read
from pmopt.errors import InputError
from pmopt.mechanisms import find

#: A value of each field that is not its default and changes a result of 2PaUU-PPaP where it is
#: read, and what has to stand beside it.
VALUES = {
    "sampler": "sobol",
    "samples": 4096,
    "replicates": 8,
    "grid": 12,
    "target_error": 0.1,
    "working_mode": "in-in",
    "norm": "fro",
    "jacobian": "homogenized",
    "characteristic_length": 2.0,
    "min_lci": 0.2,
    "regions": (0.0, 0.5, 1.0),
    "domain": {"z": (1.2, 1.5)},
    "limits": {"theta1": (-1.0, 1.0)},
    "link_diameter": 0.05,
    "platform_diameter": 0.2,
    "cone_angle": 0.6,
    "tool": (0.0, 0.0, 0.3),
    "aspect": "home",
    "block": "translational",
}
BESIDE = {
    "platform_diameter": {"link_diameter": 0.05},
    "tool": {"limits": {"tool_z": (1.2, 1.4)}},
}
FEW = {"samples": 2048}


def workspace(**settings):
    size = {} if {"samples", "grid", "target_error"} & set(settings) else FEW
    return api.workspace("2pauu-ppap", shape_grid=12, **size, **settings).to_dict()


def of_singularities(**settings):
    few = {} if "target_error" in settings else FEW
    return api.singularities("2pauu-ppap", **{"grid": 14, **few, **settings}).to_dict()


def of_capability(**settings):
    return api.capability("2pauu-ppap", speed=1.0, samples=4096, workspace=settings).to_dict()


def claim(**settings):
    domain = {"domain": {"x": (-0.1, 0.1), "y": (-0.1, 0.1), "z": (1.3, 1.5)}}
    return api.certify("2pauu-ppap", time_budget=2.0, **{**domain, **settings}).to_dict()


def index_claim(**settings):
    return claim(**{"min_lci": 0.1, **settings})


def volume(**settings):
    return api.certify_volume("2pauu-ppap", gap=0.2, **settings).to_dict()


#: Fields that are refused unless something else is asked for as well.
ALONE = {claim: {"norm", "jacobian", "characteristic_length"},
         of_capability: {"norm", "jacobian", "characteristic_length"}}  # fmt: skip
READ = {
    workspace: set(VALUES),
    of_singularities: set(survey.READS.fields) | {"grid"},  # its own: the aspects'
    of_capability: set(actuators.READS.fields) - ALONE[of_capability],
    claim: set(CLAIM_READS.fields) - ALONE[claim],
    index_claim: set(CLAIM_READS.fields),
    volume: set(VOLUME_READS.fields),
}


def test_every_field_has_a_value():
    assert set(VALUES) == set(WorkspaceSettings.model_fields)


@pytest.mark.slow
@pytest.mark.parametrize("analysis", READ, ids=lambda f: f.__name__)
def test_every_field_is_read_or_refused(analysis):
    plain = analysis()
    for name, value in VALUES.items():
        beside = BESIDE.get(name, {}) if name in READ[analysis] else {}
        if name in READ[analysis]:
            with_it, without = analysis(**{**beside, name: value}), plain
            if beside and name != "tool":
                without = analysis(**beside)
            assert with_it != without, name
        else:
            more = {"link_diameter": 0.05} if name == "platform_diameter" else {}
            with pytest.raises(InputError) as caught:
                analysis(**{name: value, **more})
            assert any(field in str(caught.value) for field in (name, *more))
            assert "read" in str(caught.value) or "not allowed" in str(caught.value)


@pytest.mark.parametrize(("analysis", "settings", "why"), [
    (of_capability, {"grid": 10}, "grid=10 is not read by capability, which reads"),
    (of_capability, {"norm": "fro"}, "norm=fro is read together with min_lci only"),
    (of_capability, {"sampler": "lines"}, "sampler=lines is not read"),
    (of_capability, {"tool": (0.0, 0.0, 1.0)}, "read together with limits on tool_x"),
    (of_singularities, {"sampler": "lines"}, "sampler=lines is not read"),
    (of_singularities, {"aspect": "home"}, "aspect=home is not read by singularities"),
    (of_singularities, {"tool": (0.0, 0.0, 1.0)}, "read together with limits on tool_x"),
    (claim, {"norm": "fro"}, "norm=fro is read together with min_lci only"),
])  # fmt: skip
def test_combinations_that_change_nothing(analysis, settings, why):
    with pytest.raises(InputError, match=why):
        analysis(**settings)


def test_a_workspace_without_shape_reads_less():
    check_read(WorkspaceSettings(grid=10), 0)
    with pytest.raises(InputError, match="tool"):
        check_read(WorkspaceSettings(tool=(0.0, 0.0, 1.0)), 0)


@pytest.mark.parametrize("words", [
    ("workspace", "2pauu-ppap", "--certify", "0.1", "--seed", "2"),
    ("singularities", "2pauu-ppap", "--path", "p.csv", "--seed", "2"),
    ("certify", "2pauu-ppap", "--norm", "fro"),
])  # fmt: skip
def test_the_command_line_refuses_too(words, tmp_path):
    assert words[-2].lstrip("-") in error_line(here(*words, cwd=tmp_path))


def test_a_search_refuses_a_tool_that_nothing_sees(tmp_path):
    text = 'mechanism = "2pauu-ppap"\n[parameters]\nm = [0.5, 1.5]\n[workspace]\ntool = [0, 0, 0.1]'
    (tmp_path / "a.toml").write_text(text)
    line = error_line(here("pareto", "a.toml", "--out", "run", cwd=tmp_path))
    assert "a.toml: workspace: tool=[0.0, 0.0, 0.1] is read together with" in line


# --- units of the index -------------------------------------------------------------------


class Fake:
    """Coordinates of a mechanism and the units of its Jacobian's entries, nothing else."""

    def __init__(self, pose, joints):
        self.pose = [type("C", (), {"kind": k}) for k in pose]
        units = {"length": "m", "angle": "rad"}
        self.entry_units = tuple(tuple(f"{units[p]}/{units[j]}" for j in joints) for p in pose)


@pytest.mark.parametrize(("pose", "joints", "units", "mixes"), [
    (["length"] * 3, ["angle"] * 3, "m/rad", False),  # a Delta, a 5R
    (["length"] * 3, ["length"] * 3, "m/m", False),  # a linear Delta
    (["angle"] * 3, ["angle"] * 3, "rad/rad", False),  # a spherical wrist
    (["length"] * 3, ["angle", "angle", "length"], "m/rad and m/m", True),
    (["length", "angle"], ["length", "length"], "m/m and rad/m", True),
])  # fmt: skip
def test_only_what_mixes_units_says_so(pose, joints, units, mixes):
    fake = Fake(pose, joints)
    assert entry_units(fake) == units
    assert mixes_units(units) is mixes
    note = index_note("raw", None, "m", units)
    assert ("it mixes units" in note) is mixes
    assert units in note


def test_the_rows_of_a_block_may_have_one_unit():
    mechanism = find("3-cur")
    assert mixes_units(entry_units(mechanism))
    assert entry_units(mechanism, "translational") == "m/m"
    found = api.workspace("3-cur", block="translational", jacobian="raw", samples=2048,
                          shape_grid=0)  # fmt: skip
    assert "mixes" not in found.index_note
