"""A tree of links as a MuJoCo model (MJCF), complete and on its own.

Bodies of the model are the links, each in its declared frame, and welded to them the declared
bodies with their mass, centre and inertia under their own names. Actuated joints bear the
coordinate's name and position and have a motor of the same name. A loop's point is an equality
``connect``; directions that stay perpendicular are a tendon between two sites at unit distance from
that point, whose length stays sqrt 2 of it: MuJoCo has no equality of its own for a universal or
revolute joint, and this needs neither a body without mass nor an equation too many.
"""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree as Xml

import numpy as np

from pmopt.analysis.multibody.model import BASE, HALF, Closure, Link, Tree
from pmopt.mechanisms.bodies import Body
from pmopt.mechanisms.mechanism import PLATFORM, Matrix, Vector

#: Engine step in s unless another is given.
STEP = 0.001
#: Share of the unconstrained acceleration that equalities leave is 1 - IMPEDANCE, MuJoCo's least.
IMPEDANCE = 0.9999
#: Time constant of the equalities, in steps. Half of what MuJoCo allows by itself (``refsafe``):
#: with Runge-Kutta steps it is stable, and what the loops give way by falls with its square.
TIME_CONSTANT = 1.0
_COLOURS = (
    "0.18 0.36 0.54 1", "0.76 0.34 0.23 1", "0.31 0.54 0.31 1", "0.54 0.35 0.66 1",
    "0.69 0.54 0.18 1",
)  # fmt: skip
_PLATFORM_COLOUR, _BASE_COLOUR = "0.45 0.45 0.48 1", "0.6 0.6 0.6 1"
_DRIVE_COLOUR = "0.89 0.2 0.18 1"
#: Radii of what is drawn, as shares of the size.
_THICK, _THIN, _BALL = 0.016, 0.009, 0.024


def to_mjcf(tree: Tree, step: float = STEP) -> str:
    """Return the model as XML text.

    Parameters
    ----------
    tree : Tree
    step : float
        The engine's step in s.
    """
    root = Xml.Element("mujoco", model=tree.mechanism)
    Xml.SubElement(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false",
                   fusestatic="false", discardvisual="false", boundmass="0",
                   boundinertia="0")  # fmt: skip
    option = Xml.SubElement(
        root, "option", timestep=_text([step]), gravity=_text(tree.gravity), integrator="RK4",
        solver="Newton", iterations="50", tolerance="1e-14", jacobian="dense",
    )  # fmt: skip
    Xml.SubElement(option, "flag", contact="disable", refsafe="disable")
    Xml.SubElement(root, "statistic", extent=_text([1.2 * tree.size]), center=_text(tree.centre))
    visual = Xml.SubElement(root, "visual")
    Xml.SubElement(visual, "headlight", ambient="0.4 0.4 0.4", diffuse="0.6 0.6 0.6",
                   specular="0 0 0")  # fmt: skip
    Xml.SubElement(visual, "global", offwidth="1280", offheight="960")
    Xml.SubElement(visual, "map", znear="0.01", zfar="50")
    asset = Xml.SubElement(root, "asset")
    Xml.SubElement(asset, "texture", type="skybox", builtin="gradient", rgb1="1 1 1",
                   rgb2="0.82 0.87 0.92", width="64", height="64")  # fmt: skip
    default = Xml.SubElement(root, "default")
    # Nothing that is drawn has a mass or touches anything.
    Xml.SubElement(default, "geom", contype="0", conaffinity="0", mass="0", group="1")
    Xml.SubElement(default, "equality", solref=_text([TIME_CONSTANT * step, 1.0]),
                   solimp=_text([IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2.0]))  # fmt: skip
    Xml.SubElement(default, "site", size=_text([0.3 * _THIN * tree.size]), rgba="0 0 0 0")
    _write_bodies(Xml.SubElement(root, "worldbody"), tree)
    tendons, equality = Xml.Element("tendon"), Xml.Element("equality")
    for first, second in tree.opposite:
        Xml.SubElement(equality, "joint", name=f"{first} and {second}", joint1=second,
                       joint2=first, polycoef="0 -1 0 0 0")  # fmt: skip
    for closure in tree.closures:
        name = closure.name
        Xml.SubElement(equality, "connect", name=name, site1=f"{name}/end", site2=f"{name}/seat")
        for k in range(len(closure.perpendicular)):
            pair = f"{name}/pair {k + 1}"
            spatial = Xml.SubElement(tendons, "spatial", name=pair, rgba="0 0 0 0",
                                     width=_text([0.1 * _THIN * tree.size]))  # fmt: skip
            for end in ("end", "seat"):
                Xml.SubElement(spatial, "site", site=f"{pair} {end}")
            Xml.SubElement(equality, "tendon", name=pair, tendon1=pair)
    root.extend(part for part in (tendons, equality) if len(part))
    actuator = Xml.SubElement(root, "actuator")
    for drive in tree.actuated:
        Xml.SubElement(actuator, "motor", name=drive, joint=drive)
    Xml.indent(root)
    return Xml.tostring(root, encoding="unicode") + "\n"


def _text(values: Iterable[float]) -> str:
    """Return numbers to all their digits."""
    return " ".join(repr(float(v) + 0.0) for v in values)


def _write_bodies(world: Xml.Element, tree: Tree) -> None:
    _write_base(world, tree)
    base = Link("base", BASE, np.zeros(3), np.eye(3), (), (), PLATFORM, ())
    links = {BASE: base} | dict(enumerate(tree.links))
    elements = {BASE: world}
    for number, link in enumerate(tree.links):
        parent = links[link.parent]
        turned = parent.rotation.T @ link.rotation
        body = Xml.SubElement(elements[link.parent], "body", name=link.name,
                              pos=_text(_seen(parent, link.origin)),
                              xyaxes=_text([*turned[:, 0], *turned[:, 1]]))  # fmt: skip
        elements[number] = body
        for freedom in link.freedoms:
            joint = Xml.SubElement(body, "joint", name=freedom.name, type=freedom.kind,
                                   pos=_text(_seen(link, freedom.point)))  # fmt: skip
            if freedom.kind != "ball":
                joint.set("axis", _text(link.rotation.T @ freedom.axis))
                joint.set("ref", _text([freedom.start]))
        _draw_link(body, link, tree)
        for one in link.bodies:
            _write_mass(body, one)
    for closure in tree.closures:
        _write_sites(elements[closure.link], links[closure.link], closure, 0, tree.size)
        _write_sites(elements[tree.platform], links[tree.platform], closure, 1, tree.size)


def _seen(link: Link, point: Vector) -> Vector:
    """Return a point of the base frame as the link sees it."""
    seen: Vector = link.rotation.T @ (point - link.origin)
    return seen


def _write_mass(parent: Xml.Element, body: Body) -> None:
    inertia: Matrix = np.asarray(body.inertia)
    element = Xml.SubElement(parent, "body", name=body.name)
    inertial = Xml.SubElement(element, "inertial", pos=_text(body.centre), mass=_text([body.mass]))
    if np.array_equal(inertia, np.diag(np.diag(inertia))):
        inertial.set("diaginertia", _text(np.diag(inertia)))
    else:
        order = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
        inertial.set("fullinertia", _text(inertia[i, j] for i, j in order))


def _write_sites(body: Xml.Element, link: Link, closure: Closure, side: int, size: float) -> None:
    end = ("end", "seat")[side]
    Xml.SubElement(body, "site", name=f"{closure.name}/{end}",
                   pos=_text(_seen(link, closure.point)))  # fmt: skip
    for k, pair in enumerate(closure.perpendicular):
        # As long as the mechanism is large: angles count as the lengths they belong to.
        point = closure.point + 0.5 * size * pair[side]
        Xml.SubElement(body, "site", name=f"{closure.name}/pair {k + 1} {end}",
                       pos=_text(_seen(link, point)))  # fmt: skip


# -- what is drawn -------------------------------------------------------------------------


def _write_base(world: Xml.Element, tree: Tree) -> None:
    count = len(tree.base)
    for k in range(count if count > 2 else 1):
        _capsule(world, tree.base[k], tree.base[(k + 1) % count], _THIN * tree.size, _BASE_COLOUR)
    for link in tree.links:
        for freedom in link.freedoms:
            if link.parent == BASE and freedom.kind == "slide":
                way = 0.6 * tree.size * freedom.axis
                _capsule(world, freedom.point - way, freedom.point + way,
                         0.6 * _THIN * tree.size, _BASE_COLOUR)  # fmt: skip


def _draw_link(body: Xml.Element, link: Link, tree: Tree) -> None:
    size = tree.size
    colour = _PLATFORM_COLOUR if link.limb == PLATFORM else _COLOURS[link.limb % len(_COLOURS)]
    points = [_seen(link, point) for point in link.path]
    slides = any(f.kind == "slide" for f in link.freedoms)
    radius = (_THIN if slides else _THICK) * size
    if link.limb == PLATFORM:
        hub, *corners = points
        for k, corner in enumerate(corners):
            _capsule(body, hub, corner, _THIN * size, colour)
            if len(corners) > 2:
                _capsule(body, corner, corners[(k + 1) % len(corners)], _THIN * size, colour)
        for freedom in link.freedoms:
            if freedom.kind == "slide":  # the rod of a telescope ends in the platform
                seat = corners[tree.carrier]
                way = HALF * (_seen(link, freedom.point) - seat)
                _capsule(body, seat, seat + way, _THIN * size, colour)
    else:
        _capsule(body, points[0], points[1], radius, colour)
        Xml.SubElement(body, "geom", type="sphere", size=_text([1.25 * radius]),
                       pos=_text(points[1]), rgba=colour)  # fmt: skip
    for freedom in link.freedoms:
        Xml.SubElement(
            body, "geom", type="sphere", pos=_text(_seen(link, freedom.point)),
            size=_text([(_BALL if freedom.actuated else 0.7 * _BALL) * size]),
            rgba=_DRIVE_COLOUR if freedom.actuated else colour,
        )  # fmt: skip


def _capsule(parent: Xml.Element, start: Vector, end: Vector, radius: float, colour: str) -> None:
    if float(np.linalg.norm(end - start)) > 0.1 * radius:
        Xml.SubElement(parent, "geom", type="capsule", fromto=_text([*start, *end]),
                       size=_text([radius]), rgba=colour)  # fmt: skip
