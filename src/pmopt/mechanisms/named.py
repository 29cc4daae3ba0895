"""Names and units of a mechanism, and what users give under those names."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from pmopt.errors import InputError, unknown_name
from pmopt.inputs.fields import Units
from pmopt.inputs.quantities import QuantityError, as_quantity, in_degrees
from pmopt.mechanisms.declarations import LARGEST_COORDINATE, Coordinate, Parameter
from pmopt.units import (
    ANGLE,
    METRES,
    ONE,
    WATT,
    LengthUnit,
    effort_unit,
    measure_unit,
    per_second,
    unit_of,
)


class Named:
    """Parameters, coordinates and modes by name, with their units.

    Lengths are in ``length_unit`` throughout, angles in radians.
    """

    name: ClassVar[str]
    length_unit: ClassVar[LengthUnit]
    parameters: ClassVar[tuple[Parameter, ...]]
    pose: ClassVar[tuple[Coordinate, ...]]
    joints: ClassVar[tuple[Coordinate, ...]]
    #: Passive-joint quantities that limits can be set on.
    passive: ClassVar[tuple[Coordinate, ...]] = ()
    parasitic: ClassVar[tuple[Coordinate, ...]] = ()
    working_modes: ClassVar[tuple[str, ...]]

    @property
    def limited(self) -> tuple[Coordinate, ...]:
        """Coordinates that limits can be set on: actuated joints, then passive ones."""
        return (*self.joints, *self.passive)

    def unit(self, coordinate: Coordinate | Parameter) -> str:
        """Return the unit of a coordinate or parameter."""
        return unit_of(coordinate.kind, self.length_unit)

    def unit_named(self, name: str) -> str | None:
        """Return the unit of a coordinate, of a limit such as ``l1_rate``, of a volume, or None.

        Efforts and power are of actuated joints.
        """
        for c in (*self.pose, *self.joints, *self.passive, *self.parasitic):
            if name == c.name:
                return self.unit(c)
            for ending, order in (("_rate", 1), ("_acceleration", 2)):
                if name == f"{c.name}{ending}":
                    return per_second(self.unit(c), order)
        for joint in self.joints:
            if name == f"{joint.name}_effort":
                return effort_unit(joint.kind)
            if name == f"{joint.name}_power":
                return WATT
        if name in ("tool_x", "tool_y", "tool_z"):
            return self.length_unit
        if name == "volume":
            return self.volume_unit
        lengths = {"projected_volume": 3, "footprint": 2}.get(name)
        return None if lengths is None else measure_unit(["length"] * lengths, self.length_unit)

    @property
    def units(self) -> Units:
        """What units in configurations of this mechanism are."""
        return Units(self.length_unit, self.unit_named)

    @property
    def entry_units(self) -> tuple[tuple[str, ...], ...]:
        """Unit of each entry of the raw Jacobian, row by row."""
        return tuple(
            tuple(f"{self.unit(row)}/{self.unit(column)}" for column in self.joints)
            for row in self.pose
        )

    @property
    def volume_unit(self) -> str:
        """Unit of a volume of poses."""
        return measure_unit([c.kind for c in self.pose], self.length_unit)

    def parameter(self, name: str) -> Parameter:
        """Return a parameter by name."""
        return next(p for p in self.parameters if p.name == name)

    def resolve(self, given: Mapping[str, Any], where: str = "params") -> dict[str, float | None]:
        """Return all parameters, those given checked and the others at their defaults.

        A value is a number in the mechanism's unit or a text with a unit, such as ``"650mm"``; an
        angle may be given in degrees under its name with ``_deg`` appended.

        Raises
        ------
        InputError
            For an unknown name or a value out of the physical range.
        """
        plain = self.plain_names(given, self.parameters, where)
        return {
            p.name: self.check_parameter(p, plain[p.name], where) if p.name in plain else p.default
            for p in self.parameters
        }

    def plain_names(
        self, given: Mapping[str, Any], known: Sequence[Coordinate | Parameter], where: str
    ) -> dict[str, Any]:
        """Return what is given under the names that are known; ``<angle>_deg`` is in degrees.

        Raises
        ------
        InputError
            For a name that is unknown or belongs elsewhere, and one that is given twice.
        """
        kinds = {k.name: k.kind for k in known}
        plain: dict[str, Any] = {}
        for name, value in given.items():
            base, found = name, value
            if name not in kinds and name.endswith("_deg"):
                base = name.removesuffix("_deg")
                found = in_degrees(value)
            if base not in kinds or (base != name and kinds[base] != "angle"):
                raise self.unknown_coordinate(where, name, list(kinds))
            if base in plain:
                raise InputError(f"{where}: {base} is given twice")
            plain[base] = found
        return plain

    def unknown_coordinate(self, where: str, name: str, allowed: Sequence[str]) -> InputError:
        """Return the error for a name that is not allowed, saying where it belongs if it is known.

        Parameters
        ----------
        where : str
        name : str
        allowed : sequence of str
        """
        base = name.removesuffix("_deg")
        places: tuple[tuple[Sequence[Coordinate | Parameter], str], ...] = (
            (self.pose, "a pose coordinate: --pose gives it, domain (--domain) bounds it"),
            (self.joints, "an actuated joint: --joints gives it, limits (--limits) bound it"),
            (self.passive, "a passive joint: limits (--limits) bound it"),
            (self.parasitic, "parasitic: it follows from the pose"),
            (self.parameters, "a parameter: parameters (--params) set it"),
        )
        for group, what in places:
            if base not in allowed and base in [c.name for c in group]:
                return InputError(f"{where}: {base} is {what}; here: {', '.join(allowed)}")
        stem, _, limb = base.rpartition("_")
        if limb.isdigit() and stem in allowed:
            return InputError(f"{where}: {name} is {stem} of one limb; here {stem} is of all limbs")
        return unknown_name(where, name, allowed)

    def beyond_bounds(self, parameters: Mapping[str, Any], where: str) -> list[str]:
        """Return one line for parameters outside their optimisation bounds, none where all are in.

        What is no number, such as a range or an unset parameter, does not count.

        It asks about a unit where a value would be within them in another one.
        """
        found = []
        for name, value in parameters.items():
            parameter = self.parameter(name)
            if not isinstance(value, float) or parameter.bounds is None:
                continue
            low, high = parameter.bounds
            if low <= value <= high:
                continue
            unit = self.unit(parameter)
            units = METRES if parameter.kind == "length" else {ANGLE: 1.0, "deg": math.pi / 180}
            meant = [
                other
                for other, size in units.items()
                if parameter.kind != "ratio"
                and other != unit
                and low <= value * size / units[unit] <= high  # type: ignore[index]
            ]
            found.append(
                f"{name} = {value:g}{'' if unit == ONE else f' {unit}'} is outside its bounds "
                f"{low:g} to {high:g}{'' if unit == ONE else f' {unit}'}"
                f"{f'; {value:g} {meant[0]}?' if meant else ''}"
            )
        return [f"{where}: {', '.join(found)}"] if found else []

    def check_parameter(self, parameter: Parameter, value: Any, where: str) -> float | None:
        """Return one parameter's value as a float, or None for an optional one that is unset."""
        if value is None and parameter.optional:
            return None
        unit = self.unit(parameter)
        reason = ""
        try:
            number = as_quantity(value, unit)
            if parameter.accepts(number):
                return number
        except QuantityError as error:
            reason = f"{error}; " if isinstance(value, str) else ""
        raise InputError(
            f"{where}: {parameter.name}={value} is not allowed: {reason}{parameter.name} "
            f"({parameter.meaning}) must be {parameter.allowed()}, in {unit}"
        )

    def check_mode(self, mode: str | None, where: str = "working mode") -> str:
        """Return the working mode, the first declared one for None."""
        if mode is None:
            return self.working_modes[0]
        if mode not in self.working_modes:
            raise unknown_name(where, mode, self.working_modes)
        return mode

    def check_ranges(
        self, ranges: Mapping[str, Any], coordinates: tuple[Coordinate, ...], where: str
    ) -> dict[str, tuple[float, float]]:
        """Return ranges of pose or joint coordinates, checked; for units see :meth:`resolve`."""
        checked = {}
        for name, value in self.plain_names(ranges, coordinates, where).items():
            coordinate = next(c for c in coordinates if c.name == name)
            ends = list(value) if isinstance(value, list | tuple) else []
            shown = ":".join(map(str, ends)) if ends else value
            try:
                pair = [as_quantity(end, self.unit(coordinate)) for end in ends]
            except QuantityError as error:
                raise InputError(f"{where}: {name}={shown} is no range: {error}") from None
            if len(pair) != 2 or not pair[0] < pair[1]:
                raise InputError(f"{where}: {name}={shown} is no range: lower < upper is needed")
            low, high = pair
            if coordinate.kind == "angle":
                # Results lie in (-pi, pi]: that is where an open range ends.
                low = -math.pi if low == -math.inf else low
                high = math.pi if high == math.inf else high
                if not low < high:
                    raise InputError(f"{where}: {name}={shown} is empty: angles lie in (-pi, pi]")
            checked[name] = (low, high)
        return checked

    def check_coordinates(
        self, given: Mapping[str, Any], coordinates: tuple[Coordinate, ...], where: str
    ) -> dict[str, float]:
        """Return a complete pose or set of joint positions as finite floats.

        For units and degrees see :meth:`resolve`.
        """
        names = [c.name for c in coordinates]
        plain = self.plain_names(given, coordinates, where)
        values: dict[str, float] = {}
        for coordinate in coordinates:
            name = coordinate.name
            if name not in plain:
                raise InputError(f"{where}: {name} is missing, needed: {', '.join(names)}")
            unit = self.unit(coordinate)
            reason = ""
            try:
                values[name] = as_quantity(plain[name], unit)
            except QuantityError as error:
                reason = f"{error}; " if isinstance(plain[name], str) else ""
                values[name] = math.nan
            if not abs(values[name]) <= LARGEST_COORDINATE:
                raise InputError(
                    f"{where}: {name}={plain[name]} is not allowed: {reason}a number of at most "
                    f"{LARGEST_COORDINATE:g} {unit} in size is needed"
                )
        return values
