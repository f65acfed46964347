"""Facets that may break, over time (`cracks.h5`, `cracks.xdmf`), and failed facets as events (`events.h5`)."""

from __future__ import annotations

from pathlib import Path

import h5netcdf
import h5py
import numpy as np

from ruptfx.bodies.state import FaultState
from ruptfx.interfaces.cracks.step import CrackStep
from ruptfx.laws.materials import WaveSpeeds
from ruptfx.run.recording import xdmf

NAMES = ("cracks.h5", "cracks.xdmf", "events.h5")
SNAPSHOTS = {
    "status": ("1", "0 whole, 1 damaged, 2 failed"), "damage": ("1", "damage, mean of both ends"),
    "opening": ("m", "inelastic opening, mean of both ends"), "slip": ("m", "inelastic slip, mean of both ends"),
    "normal_traction": ("Pa", "normal traction, positive in tension, mean of both ends"),
    "shear_traction": ("Pa", "shear traction, mean of both ends"),
}  # fmt: skip
EVENTS = {
    "time": ("s", "when the kinetic energy around the facet was largest; of aseismic events that of the failure"),
    "time_of_yield": ("s", "when the strength was reached first"),
    "time_of_failure": ("s", "when both ends had failed"),
    "x": ("m", "middle of the facet"), "y": ("m", "middle of the facet"),
    "energy": ("J", "largest increase of the kinetic energy of the four corners between yield and failure"),
    "magnitude": ("1", "(2/3) (log10 energy - 4.8), Gutenberg and Richter (1956); -inf where the event is aseismic"),
    "opening": ("m", "inelastic opening at failure, largest so far, mean of both ends"),
    "slip": ("m", "inelastic slip at failure, mean of both ends"),
    "tensile_share": ("1", "(w / delta_n)^2 over (w / delta_n)^2 + (s / delta_s)^2"),
    "inclination": ("degree", "of the facet to x, counter-clockwise, 0 to 180"), "length": ("m", "of the facet"),
    "potency_xx": ("m2", "length (opening n + slip t) n, symmetric part, per metre of thickness"),
    "potency_yy": ("m2", "likewise"), "potency_xy": ("m2", "likewise"),
}  # fmt: skip
WORDS = {
    "mode": "tensile from a tensile share of 0.75, shear up to 0.25, mixed between",
    "pair": "bodies on both sides, in the order of the alphabet",
    "joint": "joint of the mesh that the facet belongs to, empty for none",
}
MODES = ("tensile", "shear", "mixed")
TENSILE, SHEAR = 0.75, 0.25  # bounds of the tensile share: tensile from 0.75, shear up to 0.25


class CrackFiles:
    """Files with snapshots of all facets and the table of events; rank 0 only.

    Parameters
    ----------
    out : Path
        The run directory; an existing `cracks.h5` is continued.
    facets : dict of ndarray
        Data of all facets in the order of the files: `ends`, `normal`, `length`, `bodies`, `joint`, and of their laws
        `delta_n` and `delta_s`, opening and slip at failure.
    bodies, joints : list of str
        Names of the bodies, and of the joints of the mesh.
    speeds : list of WaveSpeeds
        Of the bodies [m/s].
    thickness : float
        Thickness of the bodies [m].
    kept : int, optional
        Number of snapshots to keep in an existing `cracks.h5`; later ones are removed.
    """

    def __init__(
        self, out: Path, facets: dict[str, np.ndarray], bodies: list[str], speeds: list[WaveSpeeds],
        joints: list[str], thickness: float, kept: int | None = None,
    ) -> None:  # fmt: skip
        self._out, self._facets, self._thickness = out, facets, thickness
        self._bodies, self._joints = bodies, joints
        self.path = out / "cracks.h5"
        resumed = self.path.exists()
        self._file = h5py.File(self.path, "a")
        if resumed:
            for name in ("time", *SNAPSHOTS) if kept is not None else ():
                self._file[name].resize(kept, axis=0)
            return
        ends = facets["ends"].reshape(-1, 2)
        fixed = {
            "points": (ends, "m", "ends of the facets"),
            "lines": (np.arange(len(ends)).reshape(-1, 2), "1", "ends of every facet among the points"),
            "normal": (facets["normal"], "1", "unit normal, from the first to the second body"),
            "length": (facets["length"], "m", "length of the facet"),
            "bodies": (facets["bodies"].astype(np.int32), "1", "bodies on both sides, by their place in the names"),
            "joint": (facets["joint"].astype(np.int32), "1", "joint, by its place in the names; -1 for none"),
        }
        for name, (values, unit, text) in fixed.items():
            self._file[name] = values
            self._file[name].attrs.update({"units": unit, "long_name": text})
        self._file.attrs["bodies"], self._file.attrs["joints"] = bodies, np.array(joints, h5py.string_dtype())
        for name in ("c_s", "c_R"):
            self._file.attrs[f"{name}_of_bodies"] = [getattr(each, name) for each in speeds]
        self._file.create_dataset("time", (0,), maxshape=(None,), dtype=float).attrs["units"] = "s"
        count = len(facets["length"])
        for name, (unit, text) in SNAPSHOTS.items():
            kind = np.int8 if name == "status" else float
            data = self._file.create_dataset(name, (0, count), kind, maxshape=(None, count), chunks=(1, max(count, 1)))
            data.attrs.update({"units": unit, "long_name": text})

    def append(self, time: float, state: FaultState) -> None:
        """Append the state of all facets at a time [s], and the events so far."""
        damage = state["damage"]
        fields = {
            "status": np.where((damage >= 1).all(axis=1), 2, np.where((damage > 0).any(axis=1), 1, 0)),
            "damage": damage.mean(axis=1), "opening": state["inelastic_opening"].mean(axis=1),
            "slip": state["slip"].mean(axis=1), "normal_traction": state["normal_traction"].mean(axis=1),
            "shear_traction": state["shear_traction"].mean(axis=1), "time": time,
        }  # fmt: skip
        for name, values in fields.items():
            data = self._file[name]
            data.resize(len(data) + 1, axis=0)
            data[-1] = values
        self._file.flush()
        self._describe()
        self.write_events(state)

    def _describe(self) -> None:
        times, count = self._file["time"][:], len(self._facets["length"])
        mesh = xdmf.Mesh("facets", "Polyline", ("lines", (count, 2)), ("points", (2 * count, 2)))
        xdmf.write(self._out / "cracks.xdmf", mesh, times, [
            xdmf.Field(name, name, (len(times), count), center="Cell") for name in SNAPSHOTS if name != "status"
        ])  # fmt: skip

    def write_events(self, state: FaultState) -> None:
        """Write all facets that have failed so far, in the order of their failure."""
        table, words = events(state, self._facets, self._bodies, self._joints, self._thickness)

        def write(path: Path) -> None:
            with h5netcdf.File(path, "w") as file:
                file.dimensions = {"event": len(table["time"])}
                for name, values in table.items():
                    variable = file.create_variable(name, ("event",), float)
                    variable.attrs.update(dict(zip(("units", "long_name"), EVENTS[name], strict=True)))
                    if len(values):
                        variable[:] = values
                for name, texts in words.items():
                    variable = file.create_variable(name, ("event",), h5py.string_dtype())
                    variable.attrs["long_name"] = WORDS[name]
                    if texts:
                        variable[:] = np.array(texts, dtype=object)
                file.attrs["thickness"] = self._thickness

        xdmf.replace_whole(self._out / "events.h5", write)

    def reopen(self) -> list[Path]:
        """Return files that may now be copied."""
        self._file.close()
        self._file = h5py.File(self.path, "a")
        return [path for name in ("cracks.h5", "events.h5", "cracks.xdmf") if (path := self._out / name).exists()]

    def close(self) -> None:
        self._file.close()


def facets_of(cracks: CrackStep) -> FaultState:
    """Return constant data of the facets of this rank, by the names for `CrackFiles`."""
    net, order = cracks.network, cracks.order
    opening, slip = np.full(len(order), np.nan), np.full(len(order), np.nan)
    for group in cracks.groups:
        if group.laws.cohesion is not None:
            for result, of_ends in (
                (opening, group.laws.cohesion.opening_at_failure), (slip, group.laws.cohesion.slip_at_failure)
            ):  # fmt: skip
                both = np.broadcast_to(of_ends, 2 * len(result[group.facets])).reshape(-1, 2)
                result[group.facets] = both.mean(axis=1)
    return {
        "ends": net.ends[order].reshape(-1, 4), "normal": net.normal[order], "length": net.length[order],
        "bodies": net.bodies[order].astype(float), "joint": net.joint[order].astype(float),
        "delta_n": opening, "delta_s": slip,
    }  # fmt: skip


def events(
    state: FaultState, facets: dict[str, np.ndarray], bodies: list[str], joints: list[str], thickness: float
) -> tuple[dict[str, np.ndarray], dict[str, list[str]]]:
    """Return facets that have failed, ordered by time of failure, then by number: numbers and texts by column.

    Parameters
    ----------
    state : dict of ndarray
        State of all facets.
    facets, bodies, joints, thickness
        As for `CrackFiles`.
    """
    from ruptfx.results.analysis.emission import magnitude  # imports SciPy, only if there are events

    failed = np.flatnonzero(np.isfinite(state["time_of_failure"]))
    failed = failed[np.argsort(state["time_of_failure"][failed], kind="stable")]
    of = {name: values[failed] for name, values in (state | facets).items()}
    opening, slip = of["largest_opening"].mean(axis=1), of["slip_at_failure"]
    tensile, sheared = opening / of["delta_n"], of["cohesive_slip"].mean(axis=1) / of["delta_s"]
    both = tensile**2 + sheared**2
    share = np.where(both > 0, tensile**2 / np.where(both > 0, both, 1.0), 0.0)
    ends = of["ends"].reshape(-1, 2, 2)
    middle, along = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    normal = of["normal"]
    tangent = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    jump = of["length"][:, None] * (opening[:, None] * normal + slip[:, None] * tangent)
    energy = of["energy_gain"] * thickness
    table = {
        "time": np.where(energy > 0, of["time_of_gain"], of["time_of_failure"]),
        "time_of_yield": of["time_of_yield"], "time_of_failure": of["time_of_failure"],
        "x": middle[:, 0], "y": middle[:, 1], "energy": energy, "magnitude": magnitude(energy),
        "opening": opening, "slip": slip, "tensile_share": share,
        "inclination": np.degrees(np.arctan2(along[:, 1], along[:, 0])) % 180, "length": of["length"],
        "potency_xx": jump[:, 0] * normal[:, 0], "potency_yy": jump[:, 1] * normal[:, 1],
        "potency_xy": 0.5 * (jump[:, 0] * normal[:, 1] + jump[:, 1] * normal[:, 0]),
    }  # fmt: skip
    mode = np.where(share >= TENSILE, 0, np.where(share <= SHEAR, 1, 2))
    words = {
        "mode": [MODES[number] for number in mode],
        "pair": ["-".join(sorted(bodies[body] for body in pair)) for pair in of["bodies"].astype(int).tolist()],
        "joint": [joints[number] if number >= 0 else "" for number in of["joint"].astype(int).tolist()],
    }
    return table, words
