"""The check of a mechanism: what ships holds it, and each thing wrong is found and named."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from pmopt.errors import PmoptError
from pmopt.mechanisms import find
from pmopt.mechanisms.catalogue.cur import Cur
from pmopt.mechanisms.catalogue.pauu_ppap import MECHANISM, STRUCTURE, PauuPpap, kernel, line
from pmopt.mechanisms.catalogue.uu_upu import UuUpu
from pmopt.mechanisms.mechanism import Coordinate, Parameter
from pmopt.testing import MechanismError, check_mechanism, examine

SHARES = [1.0, 2.0]
SKELETON, POSTURE = MECHANISM.skeleton, MECHANISM.posture


def test_what_ships_holds(mechanism):
    found = check_mechanism(mechanism)
    assert found.held
    assert len({(c.name, c.place) for c in found.checks}) == len(found.checks) > 25
    for check in found.checks:
        assert check.held
        assert check.count > 0
        assert (check.allowed is None) == (check.deviation is None)
        assert check.deviation is None or check.deviation < 0.2 * check.allowed


def test_nothing_is_compiled(empty_cache, mechanism):
    check_mechanism(mechanism)
    assert not list(empty_cache.iterdir())


def test_another_seed_other_poses():
    one, other = (examine(find("4-ups-rps"), seed) for seed in (1, 2))
    assert one.to_dict() != other.to_dict()
    assert one.to_dict() == examine(find("4-ups-rps"), 1).to_dict()


# --- broken in one way each: kernel functions ---------------------------------------------


def wider(x, y, z, constants):
    found = kernel(x, y, z, constants)
    return (found[0] + 0.2, *found[1:])


def turned_entry(x, y, z, constants):
    found = kernel(x, y, z, constants)
    return (*found[:8], -found[8], *found[9:])


def one_less(x, y, z, constants):
    return kernel(x, y, z, constants)[:-1]


def of_a_list(x, y, z, constants):
    found = kernel(x, y, z, constants)
    return (found[0] * SHARES[0], *found[1:])


def short_line(x, y, z, low, high, constants):
    return line(x, y, z, low, high, constants)[:2]


def narrow_line(x, y, z, low, high, constants):
    return (-0.01, 0.0, 0.0, 0.01)


def short_skeleton(x, y, z, constants):
    return SKELETON(x, y, z, constants)[1:]


def moved_segment(x, y, z, constants):
    found = SKELETON(x, y, z, constants)
    return (*found[:15], found[15] + 0.001, *found[16:])


def moved_platform(x, y, z, constants):
    found = SKELETON(x, y, z, constants)
    return (found[0] + 0.001, *found[1:])


def open_cone(x, y, z, constants):
    found = SKELETON(x, y, z, constants)
    return (*found[:-1], found[-1] * 0.9)


def long_posture(x, y, z, constants):
    return (*POSTURE(x, y, z, constants), 0.0)


def turned_posture(x, y, z, constants):
    found = POSTURE(x, y, z, constants)
    return (*found[:18], -found[18], -found[19], *found[20:])


# --- and methods --------------------------------------------------------------------------


def changed(**members):
    """Return the mechanism with some of its members replaced."""
    return type("Broken", (PauuPpap,), members)()


def constants_short(self, *given):
    return PauuPpap.kernel_constants(self, *given)[:-1]


def narrow_box(self, parameters, limits):
    lower, upper = PauuPpap.reach_box(self, parameters, limits)
    return 0.6 * lower, 0.6 * upper


def no_box(self, parameters, limits):
    return PauuPpap.reach_box(self, parameters, limits)[::-1]


def far_home(self, parameters):
    return {"x": 3.0, "y": 0.0, "z": 1.0}


def singular_home(self, parameters):
    """Both cranks stretched: the end of the reach."""
    m, n, l1, l2, c = (parameters[k] for k in ("m", "n", "l1", "l2", "c"))
    reach = l1 + l2 - 1e-14
    return {"x": 0.0, "y": 0.0, "z": 2 * c + (reach * reach - (m - n) ** 2) ** 0.5}


def home_without_z(self, parameters):
    return {"x": 0.0, "y": 0.0}


def turned_maps(self, parameters, pose, joints):
    j_x, j_q = PauuPpap.velocity_maps(self, parameters, pose, joints)
    return j_x * [[-1], [1], [1]], j_q


def maps_of_two(self, parameters, pose, joints):
    j_x, j_q = PauuPpap.velocity_maps(self, parameters, pose, joints)
    return j_x[:2], j_q[:2]


def unsigned_measures(self, parameters, pose, joints):
    found = PauuPpap.singularity_measures(self, parameters, pose, joints)
    return {**found, "forward": {"platform": abs(found["forward"]["platform"])}}


def measures_in_metres(self, parameters, pose, joints):
    found = PauuPpap.singularity_measures(self, parameters, pose, joints)
    return {**found, "inverse": {k: 100 * v for k, v in found["inverse"].items()}}


def moved_centre(self, parameters, pose, working_mode=None):
    rotation, place = PauuPpap.platform(self, parameters, pose, working_mode)
    return rotation, place + np.array([0.0, 0.0, 0.001])


def layout_with(change):
    """Return a layout whose chains are changed."""

    def layout(self, parameters, pose, working_mode=None):
        return change(list(PauuPpap.layout(self, parameters, pose, working_mode)))

    return layout


def with_joint(limb, joint, **fields):
    """Return a change of chains: one joint with other fields."""

    def change(chains):
        joints = list(chains[limb].joints)
        given = {k: v(chains) if callable(v) else v for k, v in fields.items()}
        joints[joint] = replace(joints[joint], **given)
        chains[limb] = replace(chains[limb], joints=tuple(joints))
        return tuple(chains)

    return change


def bodies_with(**fields):
    def bodies(self, parameters):
        first, *others = PauuPpap.bodies(self, parameters)
        return (replace(first, **fields), *others)

    return bodies


def raising(self, *given):
    raise ZeroDivisionError("no such luck")


def limits_of_nothing(self, parameters):
    return {"theta9": (0.0, 1.0)}


def empty_limits(self, parameters):
    return {"d": (1.0, 1.0)}


def only_above(self, parameters, limits=None):
    """Return a limit that inverse keeps, though the kernel's constants never see it."""
    return {"z": (1.0, 2.0)}


def joints_renamed(self, parameters, pose):
    return tuple(
        replace(s, joints={**s.joints, "slide": s.joints["d"]})
        for s in PauuPpap.inverse(self, parameters, pose)
    )


Y = np.array([0.0, 1.0, 0.0])
AS_A_POSE = (*PauuPpap.parameters[1:], Parameter("x", "length", 1.0, None, True, "x", "us"))
ODD = Parameter("m", "length", 1.0, (2.0, 1.5), True, "m", "us")
NAMED = tuple(Coordinate(n, "length", "a name") for n in ("x-1", "y", "z"))
#: What is wrong, what is replaced, and which check at which place has to find it.
BROKEN = {
    "a parameter called as a coordinate": ({"parameters": AS_A_POSE}, "names", "pose"),
    "a name with a dash": ({"pose": NAMED}, "names", "pose"),
    "a name twice": ({"working_modes": ("out-out", "out-out")}, "names", "working_modes"),
    "bounds reversed": ({"parameters": (ODD, *PauuPpap.parameters[1:])}, "kinds", "parameters"),
    "an unknown unit": ({"length_unit": "km"}, "kinds", "length_unit"),
    "a role too few": ({"roles": ("x", "y")}, "counts", "roles"),
    "an unknown role": ({"roles": ("x", "y", "up")}, "counts", "roles"),
    "a joint too few": ({"joints": PauuPpap.joints[:2]}, "counts", "pose"),
    "another number of freedoms": ({"freedom": "2T"}, "counts", "freedom"),
    "chains of other limbs": (
        {"structure": replace(STRUCTURE, chains=STRUCTURE.chains[::-1])}, "counts", "structure"),
    "a cone of no joint": ({"cones": ("U_C1", "U_D1", "U_C2", "U_9")}, "counts", "cones"),
    "gravity of no size": ({"down": (0.0, 0.0, -2.0)}, "counts", "down"),
    "limits of no joint": ({"default_limits": limits_of_nothing}, "ranges", "default_limits"),
    "limits that are empty": ({"default_limits": empty_limits}, "ranges", "default_limits"),
    "a home without z": ({"home": home_without_z}, "ranges", "home"),
    "a box inside out": ({"reach_box": no_box}, "ranges", "reach_box"),
    "a constant too few": ({"kernel_constants": constants_short}, "constants", "constants"),
    "an entry too few": ({"kernel": staticmethod(one_less)}, "kernel-length", "kernel"),
    "a skeleton too short": (
        {"skeleton": staticmethod(short_skeleton)}, "skeleton-length", "skeleton"),
    "a posture too long": ({"posture": staticmethod(long_posture)}, "posture-length", "posture"),
    "a line of one part": ({"line": staticmethod(short_line)}, "line-length", "line"),
    "a long axis": ({"layout": layout_with(with_joint(0, 0, axes=(2 * Y,)))}, "layout", "layout"),
    "a drive too few": ({"layout": layout_with(with_joint(0, 0, drive=None))}, "layout", "layout"),
    "a limb too few": ({"layout": layout_with(lambda c: tuple(c[:2]))}, "layout", "layout"),
    "a bar too few": ({"layout": layout_with(with_joint(0, 0, bar=None))}, "layout", "layout"),
    "no mass": ({"bodies": bodies_with(mass=0.0)}, "bodies", "bodies"),
    "no inertia of a body": (
        {"bodies": bodies_with(inertia=np.diag([1.0, 1.0, 3.0]))}, "bodies", "bodies"),
    "a body of no limb": ({"bodies": bodies_with(limb=5)}, "bodies", "bodies"),
    "bars of a link": ({"bodies": bodies_with(joint=1)}, "bodies", "bodies"),
    "two joints at a point": (
        {"layout": layout_with(with_joint(0, 2, point=lambda c: c[0].joints[1].point))},
        "bodies", "bodies"),
    "a kernel of a list": ({"kernel": staticmethod(of_a_list)}, "kernel-text", "kernel"),
    "a home out of reach": ({"home": far_home}, "home", "home"),
    "a singular home": ({"home": singular_home}, "home", "home"),
    "a margin too wide": ({"kernel": staticmethod(wider)}, "kernel-margin", "kernel"),
    "a limit the kernel forgets": ({"pose_limits": only_above}, "kernel-margin", "kernel"),
    "a box too small": ({"reach_box": narrow_box}, "box", "reach_box"),
    "a line beside what is reachable": ({"line": staticmethod(narrow_line)}, "line", "line"),
    "a joint of inverse without a name": ({"inverse": joints_renamed}, "home", "inverse"),
    "a Jacobian of another sign": (
        {"velocity_maps": turned_maps}, "jacobian-differences", "velocity_maps"),
    "a Jacobian that is not square": (
        {"velocity_maps": maps_of_two}, "jacobian-differences", "velocity_maps"),
    "an entry of another sign": (
        {"kernel": staticmethod(turned_entry)}, "kernel-jacobian", "kernel"),
    "measures without a sign": (
        {"singularity_measures": unsigned_measures}, "singularity-sign", "singularity_measures"),
    "measures with a unit": (
        {"singularity_measures": measures_in_metres}, "singularity-sign", "singularity_measures"),
    "a measure without words": ({"conditions": {}}, "singularity-sign", "singularity_measures"),
    "no forward kinematics": ({"assembly_constants": raising}, "forward", "forward"),
    "another forward kinematics": (
        {"assembly_constants": lambda self, p: [p["m"] - p["n"], p["l1"], p["l2"], 0.0]},
        "forward", "forward"),
    "a platform beside the pose": ({"platform": moved_centre}, "platform", "platform"),
    "joints that hold the platform": (
        {"layout": layout_with(with_joint(2, 2, axes=(Y,)))}, "layout-motion", "layout"),
    "a drive the other way": (
        {"layout": layout_with(with_joint(0, 0, axes=(-Y,)))}, "jacobian-screws", "layout"),
    "freedoms of another kind": ({"freedom": "1T2R"}, "freedom", "freedom"),
    "a posture with an axis turned": ({"posture": staticmethod(turned_posture)}, "posture",
                                      "posture"),
    "a segment beside the joint": ({"skeleton": staticmethod(moved_segment)}, "skeleton",
                                   "skeleton"),
    "a platform of the skeleton beside it": (
        {"skeleton": staticmethod(moved_platform)}, "skeleton", "skeleton"),
    "a cone open at home": ({"skeleton": staticmethod(open_cone)}, "cones", "cones"),
    "what raises": ({"velocity_maps": raising}, "jacobian-differences", "velocity_maps"),
    "constants that raise": ({"kernel_constants": raising}, "constants", "constants"),
}  # fmt: skip


@pytest.mark.parametrize("what", BROKEN)
def test_what_is_wrong_is_named(what):
    members, check, place = BROKEN[what]
    broken = changed(**members)
    found = examine(broken)
    assert (check, place) in {(f.check, f.place) for f in found.findings}
    assert not found.held
    assert [c for c in found.checks if not c.held]
    with pytest.raises(PmoptError) as caught:
        check_mechanism(broken)
    assert isinstance(caught.value, MechanismError)
    assert caught.value.exit_code == 4
    (line_,) = caught.value.lines
    assert line_.startswith(f"2pauu-ppap: {found.findings[0].place}: ")
    assert "\n" not in line_


def test_a_number_that_is_wrong_has_a_unit_and_a_pose():
    found = examine(changed(velocity_maps=turned_maps)).findings[0]
    assert "rad/m" in found.text
    assert " at x = " in found.text


class Parasitic(UuUpu):
    """Of which a parasitic coordinate is distinguished from another zero."""

    def inverse(self, parameters, pose):
        found = UuUpu.inverse(self, parameters, pose)
        return tuple(replace(s, parasitic={**s.parasitic, "z": -s.parasitic["z"]}) for s in found)


class Followed(Cur):
    """Of which passive joints follow the wrong freedoms."""

    followed: ClassVar = {
        name: tuple((limb, number, -weight) for limb, number, weight in terms)
        for name, terms in find("3-cur").followed.items()
    }


@pytest.mark.parametrize(("broken", "check"), [(Parasitic, "platform"), (Followed, "followed")])
def test_what_follows_from_the_pose_is_looked_at(broken, check):
    assert (check, check) in {(f.check, f.place) for f in examine(broken()).findings}


@pytest.mark.parametrize("missing", ["freedom", "parameters", "roles"])
def test_what_is_not_declared_is_named(missing):
    class Undeclared(PauuPpap):
        def __getattribute__(self, name):
            if name == missing:
                raise AttributeError(f"no attribute {name!r}", name=name, obj=self)
            return super().__getattribute__(name)

    (finding, *_) = examine(Undeclared()).findings
    assert "raises AttributeError: no attribute" in finding.text
    assert examine(object()).findings
