"""Adjoint and tangent-linear sweeps: exact transposes of each other, and exact derivatives of the run.

Products <J x, y> and <x, J' y> of the derivative J of all readings by all parameters agree to rounding, for every
friction law, contact method and plane, over 200 steps. Through a rupture with the ageing law, which has no kinks, the
remainder of Taylor's series J(p + e d) - J(p) - e <gradient, d> falls with the square of e, for parameters of the
interface and constants of the bodies, at split nodes, with compliant contact and in 3D, and tangent-linear sweeps
equal central differences. Gradients on 1, 2 and 3 ranks agree, also with a tenth of the memory, where most steps are
computed again from checkpoints; on one rank that is bitwise the same. A gradient by 10 000 unknowns costs at most three
runs.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import numpy as np
import tomli_w

from benchmarks.time_order import CONTACTS, LAWS, plates
from ruptfx import RuptfxError, Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import elastic
from ruptfx.case import Case
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.many_runs.adjoint.bodies import value_of
from ruptfx.many_runs.adjoint.gradients import Objective
from ruptfx.many_runs.adjoint.unknowns import Place, perturbed, places
from ruptfx.platform import launch
from ruptfx.readings.misfits import Unknown
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

STEPS = 200
PLANES = ("strain", "stress", "antiplane")
BODIES: dict[str, Table] = {
    "axisymmetric": {"kind": "fibre_in_matrix", "radius": 3e-3, "outer_radius": 6e-3, "length": 12e-3,
                     "element_size": 1.5e-3},
    "solid": {"kind": "box_with_fault", "fault_length": 12e-3, "fault_width": 6e-3, "element_size": 3e-3,
              "beyond": 3e-3, "distance": 3e-3},
}  # fmt: skip
FEW = ("linear_slip_weakening", "rate_and_state_ageing")  # laws of the other planes where not `fine`
SIZES = (1e-2, 1e-3, 1e-4, 1e-5)
"""Of changes. With 1e-6 the remainder would be 3e-13 to 2e-12 of the slope, and rounding errors are 2e-13 of it."""
KINDS = {
    "initial_stress.shear": 1e7, "initial_stress.normal": 1e7, "friction.a": 5e-3, "friction.b": 5e-3,
    "friction.D_c": 1e-2, "friction.f_0": 0.1, "nucleation.0.extra": 1e7,
}  # fmt: skip
"""Parameters of the rupture and sizes of their changes."""
PART = 0.3
"""Memory of the rupture in 3D over that of its whole history."""
CONSTANTS = ("density", "young_modulus", "poisson_ratio", "c_p", "c_s")
"""Constants of its bodies, which change by a tenth times the size."""


def sliding_plates(law: Table, contact: Table, plane: str, steps: int = STEPS) -> Case:
    """Return two plates that begin to slide, with an objective of slip, slip rate and motion of the bodies."""
    table = plates(law, contact, steps)
    table["plane"] = plane
    if plane == "antiplane":
        for boundary in table["boundaries"]:
            boundary["traction"] = boundary["traction"][:1]
    along = [1.0] if plane == "antiplane" else [1.0, 0.0]
    table["instruments"] = [
        {"kind": "fault_receiver", "name": "fault", "interval": 1e-7, "position": 5e-3, "bandwidth": 1e6},
        {"kind": "velocimeter", "name": "body", "interval": 1e-7, "point": [7e-3, 1.2e-3], "direction": along},
    ]
    times = {"times": [4e-6, 7.5e-6], "sigma": 1.0}
    table["objective"] = [
        {"kind": "final_slip", "sigma": 1e-6},
        {"kind": "traces", "instrument": "fault", "data": {"slip_rate": [0.0, 0.0]}, "units": {"slip_rate": "m/s"},
         **times},
        {"kind": "traces", "instrument": "body", "data": {"velocity": [0.0, 0.0]}, "units": {"velocity": "m/s"},
         **times},
    ]  # fmt: skip
    return Case.model_validate(table)


def overstressed(law: Table, contact: Table, plane: str, steps: int = STEPS) -> Case:
    """Return an interface around an axis or in 3D that slides from the start, with an objective of its slip."""
    table = plates(law, contact, steps)
    del table["boundaries"]
    table |= {"plane": plane, "mesh": BODIES[plane], "objective": [{"kind": "final_slip", "sigma": 1e-6}]}
    if plane == "solid":
        table["positions"] = "x"
    stress = table["faults"]["main"]["initial_stress"]
    stress["shear"] = {
        "kind": "boxcar", "center": 0.0 if plane == "solid" else 6e-3, "half_width": 3e-3,
        "inside": 1.5 * stress["shear"], "outside": 0.8 * stress["shear"],
    }  # fmt: skip
    return Case.model_validate(table)


def mismatch(case: Case, comm: MPI.Comm) -> float:
    """Return |<J x, y> - <x, J' y>| over the sum of the sizes of the terms, for random x and y."""
    sweeps = Objective(case, case.objective, comm).sweeps
    random = np.random.default_rng(0)
    x = [random.normal(size=each.shape) * np.abs(each) for each in sweeps.parameters]
    changes = sweeps.tangent(x)
    y = [random.normal(size=len(each)) / max(float(np.abs(each).max()), 1e-300) for each in changes]
    gradient = sweeps.adjoint(y)
    forward = [a * b for a, b in zip(changes, y, strict=True)]
    backward = [a * b for a, b in zip(gradient, x, strict=True)]
    size = sum(float(np.abs(each).sum()) for each in forward)
    return abs(sum(float(each.sum()) for each in forward) - sum(float(each.sum()) for each in backward)) / size


def rupture(contact: Table | None = None) -> Case:
    """Return a rupture with the ageing law from an overstressed patch; its contact method is split_node by default."""
    return Case.model_validate({
        "plane": "strain", "order": 4, "duration": 1.0,
        "mesh": {"kind": "half_plate", "length": 8e3, "height": 2.4e3, "element_size": 400.0},
        "materials": {"default": elastic(6000.0, 3464.0, 2670.0)},
        "damping": {"kelvin_voigt": {"eta": 7e-4}},
        "faults": {"main": {
            "contact": contact or CONTACTS["split_node"],
            "friction": {"kind": "rate_and_state_ageing", "a": 0.008, "b": 0.012, "D_c": 0.02, "f_0": 0.6, "V_0": 1e-6,
                         "V_initial": 1e-6},
            "initial_stress": {"normal": 120e6, "shear": 75e6},
            "nucleation": {"kind": "overstress", "extra": {
                "kind": "boxcar", "center": 0.0, "half_width": 1.5e3, "inside": 20e6, "outside": 0.0}},
        }},
        "boundaries": [
            {"kind": "driven", "edge": "upper.left", "component": "y", "velocity": 0.0},
            {"kind": "absorbing", "edge": "upper.right"}, {"kind": "absorbing", "edge": "upper.top"},
        ],
        "instruments": [
            {"kind": "velocimeter", "name": "body", "interval": 0.01, "point": [4e3, 800.0], "direction": [1.0, 0.0]},
        ],
        "objective": [
            {"kind": "final_slip", "sigma": 1.0, "target": 0.3},
            {"kind": "traces", "instrument": "body", "sigma": 0.3, "times": [0.6, 0.8, 0.95],
             "data": {"velocity": [0.0, 0.2, 0.4]}, "units": {"velocity": "m/s"}},
        ],
    })  # fmt: skip


def rupture_3d() -> Case:
    """Return a rupture with the ageing law from an overstressed patch of a fault in 3D."""
    table = rupture().table()
    patch = {"kind": "boxcar", "center": {"x": 0.0, "y": 0.0, "z": -2e3}, "half_width": 1.5e3, "inside": 25e6,
             "outside": 0.0}  # fmt: skip
    table["faults"]["main"]["nucleation"] = [{"kind": "overstress", "extra": patch}]
    table["faults"]["main"]["friction"]["D_c"] = 0.04
    return Case.model_validate({
        **table, "plane": "solid", "order": 2, "positions": "x", "boundaries": [], "instruments": [],
        "mesh": {"kind": "box_with_fault", "fault_length": 8e3, "fault_width": 4e3, "element_size": 500.0,
                 "beyond": 1e3, "distance": 1.5e3},
        "objective": [{"kind": "final_slip", "sigma": 1.0, "target": 0.3}],
    })  # fmt: skip


def changed_bodies(case: Case, material: str, constant: str, change: float) -> Case:
    """Return a case with another constant of a material, in which wave speeds keep each other and the density."""
    tables = case.table()["materials"]
    elastic_body = case.materials[material]
    assert isinstance(elastic_body, IsotropicElastic)
    table: dict[str, object] = dict(tables[material])
    if constant in ("c_p", "c_s"):
        for name in ("young_modulus", "poisson_ratio"):
            del table[name]
        table |= {name: value_of(elastic_body, name) for name in ("c_p", "c_s")}
    table[constant] = value_of(elastic_body, constant) + change
    return Case.model_validate({**case.table(), "materials": {**tables, material: table}})


def fixed(case: Case, comm: MPI.Comm, part: float = 1.0) -> Case:
    """Return a case with its time step as a number, or a part of it: changed bodies would have another one."""
    dt = Objective(case, case.objective, comm, record=False).sweeps.dt
    return Case.model_validate({**case.table(), "stepper": {"kind": "leapfrog", "time_step": part * dt}})


class Remainders:
    """Remainders of Taylor's series of an objective through a rupture.

    Parameters
    ----------
    comm : MPI communicator
    constants : sequence of str
        Constants of the bodies among the parameters.
    case : Case, optional
        Default is `rupture()`.
    part : float
        Memory over that of the whole history; with less than one steps are computed again.
    both_signs : bool
        Make the runs of the opposite changes, too, and compare the branches of all runs.

    Attributes
    ----------
    found : dict of str to ndarray, shape (sizes,)
        Remainder over the change of first order times the size, by kind of parameter.
    mean : dict of str to ndarray, shape (sizes,)
        The mean of the remainders of opposite changes, without terms of odd order; empty without `both_signs`.
    crossings : int
        Number of steps at points, summed over all runs, in which the point sticks, slides forward, slides backward or
        is open otherwise than in the run that was differentiated; zero without `both_signs`.
    limits : ndarray of int, shape (sizes,)
        Number of steps at points, summed over all runs of a size, in which compliant contact limits the extrapolation
        of the slip rate and did not in the run that was differentiated, or vice versa; zero without `both_signs`.
    memory : float
        That of history and checkpoints over the stated one.
    """

    def __init__(
        self, comm: MPI.Comm, constants: Sequence[str] = CONSTANTS, case: Case | None = None, part: float = 1.0,
        both_signs: bool = False,
    ) -> None:  # fmt: skip
        case = case or rupture()
        model = Model(case, comm).in_steps("explicit")
        made = Objective(case, case.objective, comm)
        self.memory = 1.0
        if part < 1:
            stated = part * float(made.sweeps.made.attributes["memory"])
            made = Objective(case, case.objective, comm, stated)
            self.memory = float(made.sweeps.made.attributes["memory"]) / stated
        gradient = {each.unknown.key: each.values for each in made.gradient()}
        known, self.found, self.mean = places(model), dict[str, np.ndarray](), dict[str, np.ndarray]()
        face, self.crossings, self.limits = model.faults[0].interface, 0, np.zeros(len(SIZES), int)
        branches = _branches(made) if both_signs else None
        for kind, size in KINDS.items():
            place = known[f"faults.main.{kind}"]
            shape = size * np.cos(face.position / 1500.0)
            slope = float(gradient[place.key] @ shape)

            def remainder(size: float, place: Place = place, shape: np.ndarray = shape, slope: float = slope) -> float:
                if place.nucleation is None:
                    view = perturbed(model, {(0, row): size * part * shape for row, part in place.rows})
                else:
                    view = perturbed(model, {}, {(0, 0): size * shape})
                other = Objective(case, case.objective, comm, model=view, record=both_signs)
                if branches is not None:
                    differ = [np.count_nonzero(a != b) for a, b in zip(_branches(other), branches, strict=True)]
                    self.crossings += int(differ[0])
                    self.limits[SIZES.index(abs(size))] += int(differ[1])
                return (other.value - made.value - size * slope) / abs(slope)

            found = [remainder(each) for each in SIZES]
            self.found[kind] = np.abs(found)
            if both_signs:
                opposite = [remainder(-each) for each in SIZES]
                self.mean[kind] = np.abs([0.5 * (a + b) for a, b in zip(found, opposite, strict=True)])
        if constants:
            self._add_constants(fixed(case, comm), made, constants, comm)

    def _add_constants(self, case: Case, made: Objective, constants: Sequence[str], comm: MPI.Comm) -> None:
        body = case.materials["default"]
        assert isinstance(body, IsotropicElastic)
        derivatives = made.gradient([Unknown(key=f"materials.default.{each}") for each in constants])
        for constant, derivative in zip(constants, derivatives, strict=True):
            size = 0.1 * value_of(body, constant)
            slope, found = size * float(derivative.values[0]), []
            for each in SIZES:
                other = changed_bodies(case, "default", constant, each * size)
                value = Objective(other, other.objective, comm, record=False).value
                found.append(abs(value - made.value - each * slope) / abs(slope))
            self.found[constant] = np.array(found)

    @property
    def least_order(self) -> float:
        """Smallest order between the first and the last size over all parameters of the interface."""
        return min(_order(self.found[kind], 0) for kind in KINDS)

    @property
    def least_order_of_means(self) -> float:
        """Smallest order between the first and the last size of the means of opposite changes."""
        return min(_order(values, 0) for values in self.mean.values())

    @property
    def least_order_of_small_changes(self) -> float:
        """Smallest order between the second and the last size over all parameters of the interface.

        Not from the first size on, at which the term of third order may be as large as that of second order.
        """
        return min(_order(self.found[kind], 1) for kind in KINDS)

    @property
    def least_order_of_bodies(self) -> float:
        """Smallest order between the second and the last size over all constants of the bodies.

        Not from the first size on, at which the term of third order in c_s is as large as that of second order.
        """
        return min(_order(values, 1) for kind, values in self.found.items() if kind not in KINDS)


def _branches(made: Objective) -> tuple[np.ndarray, np.ndarray]:
    """Return the branches of each step at each point of the first interface.

    Returns
    -------
    ndarray
        Direction of slip, 0 where stuck, 2 where open.
    ndarray of bool
        Whether the slip rate has more than doubled since the step before: `TracedLaw` then limits its extrapolation to
        the time of the traction.
    """
    sweeps = made.sweeps
    points = sweeps.points[0]
    before = points.history.index("mean_slip_rate_0")
    found, doubled = [], []
    for visit in sweeps.made.forward():
        rate, *_, stuck, opened = points.found(visit.rows[0], visit.after[0], sweeps.clocks[min(visit.step, 2)])
        found.append(np.where(opened > 0, 2.0, np.where(stuck > 0, 0.0, np.sign(rate))))
        doubled.append(np.abs(rate) > 2 * np.abs(visit.rows[0][before]))
    return np.array(found), np.array(doubled)


def _order(values: np.ndarray, first: int) -> float:
    """Return the order between one size and the last one."""
    return float(np.log10(values[first] / values[-1]) / np.log10(SIZES[first] / SIZES[-1]))


def central_differences(count: int, comm: MPI.Comm) -> float:
    """Return the largest error of tangent-linear sweeps against central differences in random directions."""
    case = rupture()
    model = Model(case, comm).in_steps("explicit")
    sweeps, worst = Objective(case, case.objective, comm).sweeps, 0.0
    names = list(sweeps.points[0].parameters)
    for seed in range(count):
        random = np.random.default_rng(seed)
        x = random.normal(size=sweeps.parameters[0].shape) * sweeps.parameters[0]
        x[[name.endswith("theta_initial") for name in names]] = 0.0
        exact = sweeps.tangent([x])
        step = 1e-5
        both = []
        for sign in (1, -1):
            view = perturbed(model, {(0, name): sign * step * row for name, row in zip(names, x, strict=True)})
            made = Objective(case, case.objective, comm, model=view, record=False)
            both.append([sample.values for _, sample in made.samples])
        for one, other, linear in zip(*both, exact, strict=True):
            error = np.linalg.norm((one - other) / (2 * step) - linear) / np.linalg.norm(linear)
            worst = max(worst, float(error))
    return worst


def cost(comm: MPI.Comm, part: float = 1.0) -> float:
    """Return the time of a gradient by 10 000 unknowns over that of a run, median of three.

    Parameters
    ----------
    comm : MPI communicator
    part : float
        Memory over that of the whole history.
    """
    table = plates(LAWS["linear_slip_weakening"], CONTACTS["split_node"], STEPS)
    table |= {"plane": "strain", "order": 4, "duration": 4e-6, "stepper": {"kind": "leapfrog"}}
    table["mesh"] = {"kind": "two_plates", "length": 0.5, "height": 20e-3, "element_size": 1e-3}
    table["objective"] = [{"kind": "final_slip", "sigma": 1e-6}]
    case = Case.model_validate(table)
    model, ratios = Model(case, comm), []
    made = Objective(case, case.objective, comm, model=model)
    if part < 1:
        made = Objective(case, case.objective, comm, part * float(made.sweeps.made.attributes["memory"]), model=model)
    motion = case.stepper.bind(model)
    for _ in range(3):
        state, began = model.initial_state(), time.process_time()
        for _ in range(made.sweeps.steps):
            motion.step(state)
        run, began = time.process_time() - began, time.process_time()
        made.sweeps.run_again()
        made.gradient()
        ratios.append((time.process_time() - began) / run)
    return median(ratios)


def of_ranks(ranks: int = 2, part: float = 1.0) -> float:
    """Return the largest difference of gradients on 1 rank and on several, relative to the largest of each unknown.

    Parameters
    ----------
    ranks : int
    part : float
        Memory on the ranks over that of the whole history on one rank; with less than one steps are computed again.
    """
    import xarray

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "rupture.toml")
        keys = [*(f"faults.main.{kind}" for kind in KINDS), "materials.default.density", "materials.default.c_s"]
        table = {**rupture().table(), "unknowns": [{"key": key} for key in keys]}
        path.write_text(tomli_w.dumps(table), encoding="utf-8")
        found: list[xarray.Dataset] = []
        for count in (1, ranks):
            # Ranks that share points keep more than one rank alone.
            memory = part * found[0].attrs["memory"] if found and part < 1 else 4e9
            out = Path(folder, str(len(found)))
            options = ["--out", str(out), "--memory", str(memory / 1e9), "--quiet"]
            if launch.run_on(count, ["gradient", str(path), *options]):
                raise RuptfxError(f"bench adjoint: the gradient did not run on {count} rank(s)")
            found.append(xarray.load_dataset(out / "gradient.nc", engine="h5netcdf"))
        one, other = found
        if ("computed again" in other.attrs["history"]) != (part < 1):
            raise RuptfxError("bench adjoint: the memory was not used as stated")
        return max(
            float(np.abs(one[name] - other[name]).max() / max(float(np.abs(one[name]).max()), 1e-300))
            for name in one.data_vars
        )


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    checks = []
    for plane in PLANES:
        for name, contact in CONTACTS.items():
            laws = LAWS if fine or plane == PLANES[0] else {law: LAWS[law] for law in FEW}
            worst = max(mismatch(sliding_plates(law, contact, plane), comm) for law in laws.values())
            quantity = f"transpose, {plane}, {name}, {len(laws)} laws: |<Jx, y> - <x, J'y>|"
            checks.append(Check(quantity, 0.0, worst, 1e-12, "1", "exact transposes"))
    for plane in BODIES:
        for name, contact in CONTACTS.items():
            laws = LAWS if fine else {law: LAWS[law] for law in FEW}
            worst = max(mismatch(overstressed(law, contact, plane), comm) for law in laws.values())
            quantity = f"transpose, {plane}, {name}, {len(laws)} laws: |<Jx, y> - <x, J'y>|"
            checks.append(Check(quantity, 0.0, worst, 1e-12, "1", "exact transposes"))
    remainders = Remainders(comm)
    checks.append(Check("order of Taylor's remainder, 1e-2 to 1e-5", 2.0, remainders.least_order, 0.05, "1",
                        "gradient exact", "at least"))  # fmt: skip
    checks.append(Check("the same by density, moduli and wave speeds of the bodies, 1e-3 to 1e-5", 2.0,
                        remainders.least_order_of_bodies, 0.05, "1", "gradient exact", "at least"))  # fmt: skip
    compliant = Remainders(comm, (), rupture({"kind": "compliant", "C_n": 2e9, "C_s": 2e9}), both_signs=fine)
    checks.append(Check("order of Taylor's remainder with compliant contact, 1e-3 to 1e-5", 2.0,
                        compliant.least_order_of_small_changes, 0.05, "1", "gradient exact", "at least"))  # fmt: skip
    if fine:
        checks += [
            Check("the same, 1e-2 to 1e-5", 2.0, compliant.least_order, 0.05, "1", "gradient exact", "at least"),
            Check("the same, 1e-2 to 1e-5, mean of opposite changes", 2.0, compliant.least_order_of_means, 0.05, "1",
                  "terms of third order drop out", "at least"),
            Check("steps at points that stick, slide or open otherwise in these 56 runs", 0.0, compliant.crossings, 0.0,
                  "1", "rate and state always slides", "at most"),
            Check("steps at points where the limit of extrapolation acts otherwise, 1e-4 to 1e-5", 0.0,
                  int(compliant.limits[2:].sum()), 0.0, "1", "no kinks in small changes", "at most"),
        ]  # fmt: skip
    checks.append(Check("transpose through a rupture in 3D: |<Jx, y> - <x, J'y>|", 0.0, mismatch(rupture_3d(), comm),
                        1e-12, "1", "exact transposes"))  # fmt: skip
    solid = Remainders(comm, (), rupture_3d(), PART)
    checks.append(Check("order of Taylor's remainder in 3D, 30 % of the memory, 1e-2 to 1e-5", 2.0, solid.least_order,
                        0.05, "1", "gradient exact", "at least"))  # fmt: skip
    checks.append(Check("memory of history and checkpoints there over the stated one", 1.0, solid.memory, 0.0, "1",
                        "kept", "at most"))  # fmt: skip
    checks.append(Check("tangent-linear sweep against central differences", 0.0,
                        central_differences(20 if fine else 4, comm), 1e-6, "1", "derivative"))  # fmt: skip
    for ranks, part in ((2, 1.0), (3, 1.0), (1, 0.1), (3, 0.1)):
        text = f"gradients on 1 and {ranks} ranks" if ranks > 1 else "gradients on 1 rank"
        checks.append(Check(text + ", a tenth of the memory" * (part < 1), 0.0, of_ranks(ranks, part),
                            1e-10 if ranks > 1 else 0.0, "1", "1 rank, all in memory"))  # fmt: skip
    checks.append(Check("cost of a gradient by 10 000 unknowns over a run", 3.0, cost(comm), 0.0, "1",
                        "forward, and backward with the same kernel", "at most", timing=True))  # fmt: skip
    checks.append(Check("the same cost in 35 % of the memory", 5.0, cost(comm, 0.35), 0.0, "1",
                        "two runs forward, and backward", "at most", timing=True))  # fmt: skip
    return Outcome(checks, lambda: _draw(remainders))


def _draw(remainders: Remainders) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((ax,),) = new_figure(1, 1, 3.0, 6.0)
    for kind, values in remainders.found.items():
        line = "o-" if kind in KINDS else "s--"
        ax.loglog(SIZES, values, line, ms=3, lw=1, label=kind if kind in KINDS else f"bodies: {kind}")
    first = max(float(values[0]) for values in remainders.found.values())
    ax.loglog(SIZES, 2 * first * (np.array(SIZES) / SIZES[0]) ** 2, "k:", lw=1, label="second order")
    ax.set(xlabel="Size of the change", ylabel="Taylor's remainder over the slope")
    ax.legend(frameon=False, fontsize="x-small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
