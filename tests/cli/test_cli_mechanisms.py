"""Every command for every mechanism of the catalogue, as a process and in this one."""

import math
import tomllib

import numpy as np
import pytest
from support.cli_runner import (
    CONFIGS,
    csv_rows,
    error_line,
    files_in,
    here,
    json_answer,
    pmopt,
    strict_json,
)

from pmopt.mechanisms import find, names
from pmopt.synthesis.config import resolve_config
from pmopt.synthesis.problem import DesignProblem

#: A pose that no limb reaches, and a design that cannot be assembled anywhere.
FAR = {
    "2pauu-ppap": "x=9,y=0,z=1",
    "3-cur": "z=0.4,beta=1.5,gamma=1.5",
    "3-ups-sp": "phi=0,theta=1.4,psi=1.4,l4=400",
    "4-ups-rps": "x=2000,y=0,alpha=0,beta=0,gamma=1.57",
    "2uu-upu": "x=3,beta=0,gamma=0",
}
IMPOSSIBLE = {
    "2pauu-ppap": "l1=0.01,l2=0.02,m=5",
    "3-cur": "Ra=1,Rb=0.1,L=0.2",
    "3-ups-sp": "A=1000",
    "4-ups-rps": "R=3000,R1=3000",
    "2uu-upu": "bs=3,L=0.2",
}
SMALL = ("--samples", "4096")


def shown(values):
    return ",".join(f"{k}={v!r}" for k, v in values.items())


def home(mechanism):
    return mechanism.home(mechanism.resolve({}))


def test_inverse_forward_and_jacobian_agree(mechanism, tmp_path):
    """From home to joints and back, and the same index from both commands."""
    pose = home(mechanism)
    inverse = json_answer("ik", mechanism.name, "--pose", shown(pose), cwd=tmp_path)
    (first, *_) = inverse["solutions"]
    assert first["working_mode"] == mechanism.working_modes[0]
    assert first["within_limits"]
    assert set(first["parasitic"]) == {c.name for c in mechanism.parasitic}
    forward = json_answer("fk", mechanism.name, "--joints", shown(first["joints"]), cwd=tmp_path)
    assert forward["solutions"][0]["pose"] == pytest.approx(pose, abs=1e-6)
    near = json_answer(
        "fk", mechanism.name, "--joints", shown(first["joints"]), "--near", shown(pose),
        cwd=tmp_path,
    )  # fmt: skip
    assert near["solutions"] == forward["solutions"][:1]
    jacobian = json_answer("jacobian", mechanism.name, "--pose", shown(pose), cwd=tmp_path)
    size = len(mechanism.joints)
    assert [len(row) for row in jacobian["J"]] == [size] * size
    assert 0 < jacobian["lci"] <= 1
    assert jacobian["characteristic_length"] > 0
    best = json_answer("jacobian", mechanism.name, "--pose", shown(pose),
                       "--characteristic-length", "optimal", cwd=tmp_path)  # fmt: skip
    assert best["lci"] >= jacobian["lci_homogenized"] - 1e-12
    document = json_answer("info", mechanism.name, cwd=tmp_path)
    assert document["home"] == pose
    assert document["working_modes"] == list(mechanism.working_modes)


@pytest.mark.slow
def test_the_same_bytes_from_a_process(mechanism, tmp_path):
    for args in (
        ("mobility", mechanism.name, "--samples", "4"),
        ("workspace", mechanism.name, *SMALL, "--shape-grid", "8"),
        ("singularities", mechanism.name, *SMALL, "--grid", "8"),
    ):
        process = pmopt(*args, "--format", "json", cwd=tmp_path)
        inside = here(*args, "--format", "json", cwd=tmp_path)
        assert process.returncode == 0, process.stderr
        assert process.stdout == inside.stdout
        document = strict_json(process.stdout)
        assert document["mechanism"] == mechanism.name


def test_folders_hold_pictures_and_tables(mechanism, tmp_path):
    """Workspace with the positions reached, singularities with loci, and plot draws them again."""
    args = (*SMALL, "--out", "run", "--format", "json")
    assert here("workspace", mechanism.name, *args, cwd=tmp_path).returncode == 0
    held = files_in(tmp_path / "run")
    assert {"mechanism.png", "sections.png", "result.json", "regions.csv"} <= set(held)
    assert ("positions.png" in held) == any(c.kind == "angle" for c in mechanism.pose)
    assert ("workspace.png" in held) == (len(mechanism.pose) == 3)
    if len(mechanism.pose) > 3:  # test_cli.py draws those of three coordinates again
        drawn = json_answer("plot", "run", "--out", "again", cwd=tmp_path)["written"]
        assert sorted(drawn) == sorted(f"again/{n}" for n in held if n.endswith(".png"))
        for name in drawn:
            assert (tmp_path / name).read_bytes() == (
                tmp_path / "run" / name.removeprefix("again/")
            ).read_bytes()
    args = (*SMALL, "--grid", "8", "--out", "singular", "--format", "json")
    assert here("singularities", mechanism.name, *args, cwd=tmp_path).returncode == 0
    held = files_in(tmp_path / "singular")
    assert {"aspects.csv", "families.csv", "walls.csv", "sections.png"} <= set(held)
    assert csv_rows((tmp_path / "singular/aspects.csv").read_text())
    drawn = json_answer("plot", "singular", "--out", "loci", cwd=tmp_path)["written"]
    assert "loci/sections.png" in drawn


def test_draw(mechanism, tmp_path):
    args = ("draw", mechanism.name, "--out", "one.png")
    assert here(*args, cwd=tmp_path).returncode == 0
    assert (tmp_path / "one.png").read_bytes().startswith(b"\x89PNG")
    assert "--force" in error_line(here(*args, cwd=tmp_path))
    line = error_line(here("draw", mechanism.name, "--pose", FAR[mechanism.name], "--out",
                           "far.png", cwd=tmp_path))  # fmt: skip
    assert "reach" in line
    assert files_in(tmp_path) == ["one.png"]


def test_a_path_over_poses(mechanism, tmp_path):
    """From home to a pose beside it and back, with times and angles in degrees."""
    pose = home(mechanism)
    heads = [c.name + ("_deg" if c.kind == "angle" else "") for c in mechanism.pose]
    rows = [["t", *heads]]
    for t, share in ((0.0, 0.0), (0.5, 0.001), (1.0, 0.0)):
        values = [
            math.degrees(pose[c.name] + share) if c.kind == "angle" else pose[c.name] * (1 + share)
            for c in mechanism.pose
        ]
        rows.append([str(t), *map(repr, values)])
    (tmp_path / "path.csv").write_text("\n".join(map(",".join, rows)) + "\n")
    args = ("singularities", mechanism.name, "--path", "path.csv")
    document = json_answer(*args, cwd=tmp_path)
    assert document["rows"] == 3
    assert document["crossings"] == []
    assert {n["kind"] for n in document["nearest"]} >= {"inverse", "forward"}
    assert "--grid" in error_line(here(*args, "--grid", "8", cwd=tmp_path))
    (tmp_path / "path.csv").write_text("\n".join(map(",".join, rows[:2])) + "\n")
    assert "at least two" in error_line(here(*args, cwd=tmp_path))


def test_out_of_reach_names_a_limb_and_by_how_much(mechanism, tmp_path):
    line = error_line(here("ik", mechanism.name, "--pose", FAR[mechanism.name], cwd=tmp_path))
    assert "limb" in line
    assert "misses" in line
    assert mechanism.length_unit in line


def test_impossible_dimensions_are_one_line(mechanism, tmp_path):
    """Nothing reachable is an answer of exit code 3, never a traceback or NaN."""
    bad = ("--params", IMPOSSIBLE[mechanism.name], "--quiet")  # no line about bounds
    result = here("workspace", mechanism.name, *bad, *SMALL, "--format", "json", cwd=tmp_path)
    if result.returncode:
        error_line(result, result.returncode)
    else:
        assert strict_json(result.stdout)["volume"]["value"] == 0
    for command in ("singularities", "mobility"):
        result = here(command, mechanism.name, *bad, cwd=tmp_path)
        if result.returncode:
            assert result.returncode in (2, 3)
            error_line(result, result.returncode)
    pose = shown(home(mechanism))
    for command in ("ik", "jacobian"):
        result = here(command, mechanism.name, *bad, "--pose", pose, cwd=tmp_path)
        assert result.returncode == 2, (command, result.stdout)
        error_line(result)
    error_line(here("workspace", mechanism.name, "--params", "nonsense=1", cwd=tmp_path))


@pytest.mark.parametrize("name", names())
def test_shipped_configuration_finds_two_ends(name, tmp_path):
    """A tenth of the search: the ends of the front still differ clearly."""
    text = (CONFIGS / f"{name}.toml").read_text()
    for key, value in {"population": 20, "generations": 5, "samples": "2000"}.items():
        lines = [f"{key} = {value}" if line.startswith(f"{key} =") else line
                 for line in text.splitlines()]  # fmt: skip
        text = "\n".join(lines)
    text = text.replace("target_error = ", "target_error = 2e-2 # ")
    assert tomllib.loads(text)["algorithm"]["population"] == 20
    (tmp_path / "small.toml").write_text(text + "\n")
    assert here("pareto", "small.toml", "--out", "run", "--quiet", cwd=tmp_path).returncode == 0
    front = csv_rows((tmp_path / "run/front.csv").read_text())
    cells = [row[k] for row in front for k in row]
    assert not {"nan", "inf", "-inf", ""} & set(cells)
    volumes, indices = ([float(row[k]) for row in front] for k in ("volume", "gci"))
    assert max(volumes) > 1.2 * min(volumes)
    assert max(indices) > 1.05 * min(indices)


CROSS = """
mechanism = "{name}"
objectives = {objectives}
[parameters]
{fixed}
[workspace]
samples = 1500
limits = {limits}
[algorithm]
population = 6
generations = 2
[constraints]
{constraints}
[final]
target_error = 0.2
"""


@pytest.mark.parametrize("name", names())
def test_objectives_and_constraints_of_every_kind(name, tmp_path):
    """Positions and floor as objectives, bounds on quantities and joints, degenerate designs."""
    limits = "{l1 = [0.0, 80.0]}" if name == "3-ups-sp" else "{}"
    # All but two stay as they are.
    fixed = [p for p in find(name).parameters if p.bounds and p.default is not None][2:]
    text = CROSS.format(
        name=name, fixed="\n".join(f"{p.name} = {p.default}" for p in fixed), limits=limits,
        objectives='["projected_volume", "footprint", "gci"]',
        constraints="volume = {min = 1e-6}\ngci = {max = 0.99}",
    )  # fmt: skip
    (tmp_path / "cross.toml").write_text(text)
    result = here("pareto", "cross.toml", "--out", "run", "--format", "json", cwd=tmp_path)
    if result.returncode == 3:
        error_line(result, 3)
        return
    assert result.returncode == 0, result.stderr
    front = csv_rows((tmp_path / "run/front.csv").read_text())
    for row in front:
        for key in ("projected_volume", "footprint", "gci", "volume_min", "gci_max"):
            assert math.isfinite(float(row[key]))
        assert float(row["volume_min"]) >= 0
    units = strict_json((tmp_path / "run/manifest.json").read_text())["units"]
    unit = find(name).length_unit
    assert (units["projected_volume"], units["footprint"]) == (f"{unit}^3", f"{unit}^2")


def test_designs_with_too_few_poses_to_tell_positions_are_infeasible():
    """Something is reachable and has an index, but no volume of positions: no NaN is a design."""
    limits = {f"l{k}": [940, 1060] for k in range(1, 6)}
    config = {
        "mechanism": "4-ups-rps", "objectives": ["projected_volume", "gci"],
        "workspace": {"samples": 4000, "limits": limits},
    }  # fmt: skip
    problem = DesignProblem(resolve_config(config, "here"))
    unit = np.random.default_rng(0).random((60, len(problem.lower)))
    found = problem.evaluate(problem.lower + (problem.upper - problem.lower) * unit)
    missing = np.isnan(found.values)
    assert (missing[:, 0] & ~missing[:, 1]).any()
    assert not (missing.any(axis=1) & found.feasible).any()
