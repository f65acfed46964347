"""Sources of SEM2DPACK: forces, moments and plane waves, and their time functions."""

from __future__ import annotations

import numpy as np

from ruptfx import Table
from ruptfx.app.convert.sem2dpack.blocks import Block, ConversionError, Floats, Input
from ruptfx.app.convert.sem2dpack.layout import Layout

READS = {
    "SRC_DEF", "SRC_FORCE", "SRC_WAVE", "SRC_MOMENT", "SRC_DOUBLE_COUPLE", "SRC_EXPLOSION", "SRC_RICKER", "STF_RICKER",
    "STF_GAUSSIAN", "STF_BRUNE", "STF_TAB", "STF_GAUSSXSIN",
}  # fmt: skip
SAMPLES = 2000


def read(
    value: Input, layout: Layout, plane: str, duration: float, boundaries: list[Table], open_edges: list[str]
) -> list[Table]:
    """Return the boundaries of a case with its sources.

    Parameters
    ----------
    boundaries : list of dict
        The boundaries without sources.
    open_edges : list of str
        Absorbing edges that let waves in; a plane wave replaces their entries.

    Raises
    ------
    ConversionError
    """
    items = list(boundaries)
    for block in value.all("SRC_DEF"):
        own = value.following(block, ("SRC_", "STF_"), ("SRC_DEF",))
        amplitude, history = _course(value, block.word("stf"), own, duration)
        mechanism = block.word("mechanism")
        if mechanism == "WAVE":
            wave = _wave(_block(own, "SRC_WAVE"), plane, amplitude, history)
            if not open_edges:
                raise ConversionError(
                    "&SRC_DEF mechanism = 'WAVE': no absorbing edge lets the wave in; give the edge that it comes "
                    "from kind = 'ABSORB'"
                )
            items = [wave | {"edge": each["edge"]} if each.get("edge") in open_edges and each["kind"] == "absorbing"
                     else each for each in items]  # fmt: skip
            continue
        if block.word("file"):
            points = [(float(x), float(z)) for x, z in value.table(block, 2)]
        else:
            points = [block.pair("coord")]
        action = _action(mechanism, own, plane, amplitude)
        items += [action | layout.place(point, at_node=True) | {"history": history} for point in points]
    return items


def _block(own: list[Block], name: str) -> Block:
    return next((block for block in own if block.name == name), Block(name, {}))


def _wave(block: Block, plane: str, amplitude: float, history: Table) -> Table:
    """Return a plane wave; angles turn counter-clockwise from up."""
    angle, phase = np.deg2rad(block.number("angle", 0.0)), block.word("phase", "S")
    phase = "S" if plane == "antiplane" else phase
    # Their S waves in the plane move to the right of the direction, ours to the left.
    sign = -1.0 if phase == "S" and plane != "antiplane" else 1.0
    return {
        "kind": "incident_wave", "wave": phase, "direction": [float(-np.sin(angle)), float(np.cos(angle))],
        "velocity": sign * amplitude, "history": history,
    }  # fmt: skip


def _action(mechanism: str, own: list[Block], plane: str, amplitude: float) -> Table:
    """Return a force or a moment without its place."""
    antiplane = plane == "antiplane"
    if mechanism == "FORCE":
        angle = np.deg2rad(_block(own, "SRC_FORCE").number("angle", 0.0))
        along = [1.0] if antiplane else [float(-np.sin(angle)), float(np.cos(angle))]
        return {"kind": "point_force", "force": [amplitude * each for each in along]}
    if mechanism == "EXPLOSION" and not antiplane:
        entries = [1.0, 1.0, 0.0]
    elif mechanism == "DOUBLE_COUPLE":
        # The fault dips by this angle to the right; positive: the right side moves up, or along positive y.
        dip = np.deg2rad(_block(own, "SRC_DOUBLE_COUPLE").number("dip", 90.0))
        s, c = float(np.sin(dip)), float(np.cos(dip))
        entries = [s, c] if antiplane else [-2 * s * c, 2 * s * c, s * s - c * c]
    elif mechanism == "MOMENT":
        block = _block(own, "SRC_MOMENT")
        if not antiplane and block.number("mxz", 0.0) != block.number("mzx", 0.0):
            raise ConversionError(
                f"&SRC_MOMENT Mxz = {block.number('mxz', 0.0):g}, Mzx = {block.number('mzx', 0.0):g}: must be equal, a "
                "moment tensor is symmetric"
            )
        entries = [block.number(key, 0.0) for key in (("myx", "myz") if antiplane else ("mxx", "mzz", "mxz"))]
    else:
        raise ConversionError(
            f"&SRC_DEF mechanism = '{mechanism}': no counterpart in this plane; write a boundary of kind point_force "
            "or moment into the case"
        )
    return {"kind": "moment", "moment": [amplitude * each for each in entries]}


def _course(value: Input, kind: str, own: list[Block], duration: float) -> tuple[float, Table]:
    """Return the amplitude and the history of a time function."""
    block = _block(own, f"STF_{kind}")
    if kind == "RICKER":
        if not block.values:
            block = _block(own, "SRC_RICKER")
            value.note("&SRC_RICKER is read as &STF_RICKER")
        # Its central peak is minus the amplitude.
        ricker: Table = {"kind": "ricker", "frequency": block.number("f0"), "delay": block.number("onset", 0.0)}
        return -block.number("ampli", 1.0), ricker
    if kind == "TAB":
        from scipy.interpolate import CubicSpline

        times, values = value.table(block, 2).T
        fine = np.union1d(times, np.linspace(times[0], times[-1], SAMPLES))
        return 1.0, _sampled(fine, CubicSpline(times, values)(fine))
    t = np.linspace(0.0, duration, SAMPLES)
    if kind == "GAUSSIAN":
        values = np.exp(-((np.pi * block.number("f0", 1.0) * (t - block.number("onset", 0.0))) ** 2))
    elif kind == "BRUNE":
        turns = 2 * np.pi * block.number("fc", 1.0) * t
        values = 1 - (1 + turns) * np.exp(-turns)
    elif kind == "GAUSSXSIN":
        later, width = t - block.number("onset", 0.0), block.number("std", 1.0)
        values = np.exp(-0.5 * (later / width) ** 2) * np.sin(block.number("f0", 1.0) * later)
    else:
        raise ConversionError(
            f"&SRC_DEF stf = '{kind}': must be one of RICKER, GAUSSIAN, BRUNE, GAUSSXSIN and TAB; write other "
            "functions as a table, TAB"
        )
    return block.number("ampli", 1.0), _sampled(t, values)


def _sampled(times: Floats, values: Floats) -> Table:
    return {"kind": "sampled", "times": times.tolist(), "values": values.tolist()}
