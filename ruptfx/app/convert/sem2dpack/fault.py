"""Faults of SEM2DPACK: slip-weakening, time-weakening, rate-and-state and linear-slip interfaces."""

from __future__ import annotations

from ruptfx import Table
from ruptfx.app.convert.sem2dpack.blocks import NO_COUNTERPART, Block, ConversionError, Input
from ruptfx.app.convert.sem2dpack.boundaries import Fault
from ruptfx.app.convert.sem2dpack.distributions import value
from ruptfx.app.convert.sem2dpack.fault_line import FaultLine

READS = {"BC_DYNFLT", "BC_DYNFLT_SWF", "BC_DYNFLT_TWF", "BC_DYNFLT_RSF", "BC_DYNFLT_NOR", "BC_LSF"}
LAWS = {"SWF", "TWF", "RSF"}
HUGE = 1e30
PRESSED = 1e10  # Pa
STRESSES = ("sxx", "sxy", "sxz", "syz", "szz")


def read(value: Input, fault: Fault, line: FaultLine, antiplane: bool) -> Table:
    """Return the table of the fault of a case.

    Raises
    ------
    ConversionError
    """
    return _linear_slip(value, fault) if fault.kind == "LISFLT" else _Friction(value, fault, line, antiplane).table()


def _linear_slip(value: Input, fault: Fault) -> Table:
    """Return springs between the two sides: a compliant interface that neither opens nor slips otherwise."""
    block = next((block for block in fault.blocks if block.name == "BC_LSF"), Block("BC_LSF", {}))
    stiffness = {}
    for ours, direction in (("C_n", "norm"), ("C_s", "tang")):
        compliance = block.number(f"c{direction}", 0.0)
        stiffness[ours] = 1 / compliance if compliance else block.number(f"k{direction}", HUGE)
        if not 0 < stiffness[ours] < HUGE:
            raise ConversionError(
                f"&BC_LSF k{direction}, c{direction}: a fault that is welded or free in one direction has no "
                "counterpart; give a stiffness"
            )
    value.note(f"the linear-slip fault is compliant and pressed with {PRESSED:g} Pa, so that it never opens or slips")
    return {
        "contact": {"kind": "compliant", **stiffness}, "initial_stress": {"normal": PRESSED, "shear": 0.0},
        "friction": {"kind": "coulomb", "mu_d": 1.0},
    }  # fmt: skip


class _Friction:
    """The blocks of a frictional fault, read in the order in which distributions follow them."""

    def __init__(self, given: Input, fault: Fault, line: FaultLine, antiplane: bool) -> None:
        self.given, self.line, self.antiplane, self.inside = given, line, antiplane, len(fault.tags) > 1
        self.parts: dict[str, tuple[Block, list[Block]]] = {}
        for block in fault.blocks:
            if block.name.startswith("DIST_") and self.parts:
                self.parts[next(reversed(self.parts))][1].append(block)
            elif block.name in READS:
                self.parts[block.name] = block, []

    def of(self, name: str) -> tuple[Block, list[Block]]:
        """Return a block and the distributions that follow it; an empty one where it is missing."""
        return self.parts.get(name, (Block(name, {}), []))

    def values(self, name: str, keys: dict[str, tuple[str, float]]) -> Table:
        """Return values by our names; `keys` gives their names and defaults, in the order of their distributions."""
        block, shapes = self.of(name)
        return {
            ours: value(self.given, block, theirs, default, shapes, self.line)
            for ours, (theirs, default) in keys.items()
        }

    def table(self) -> Table:
        block = self.of("BC_DYNFLT")[0]
        if not block.get("opening", True) and not self.antiplane:
            self.given.refuse("BC_DYNFLT.opening", "an interface that carries tension without opening")
        self.given.refuse_keys(block, "pore pressure that follows a time function", "pp")
        stress = self.values(
            "BC_DYNFLT",
            {key: (key, 0.0) for key in ("cohesion", "tn", "tt", *STRESSES)} | {"v": ("v", 1e-12)},
        )
        names = [name for name in block.words("friction", "SWF") if name]
        for name in set(names) - LAWS if set(names) & LAWS else ():
            self.given.refuse(f"BC_DYNFLT_{name}", NO_COUNTERPART)
            names.remove(name)
        slip_weakening, rate_and_state = "SWF" in names, "RSF" in names
        if set(names) - LAWS or (slip_weakening and rate_and_state) or not names:
            raise ConversionError(
                f"&BC_DYNFLT friction = {names}: must be SWF, TWF, RSF, or one of SWF and RSF with TWF"
            )
        friction = self._rate_and_state(stress["v"]) if rate_and_state else self._slip_weakening()
        nucleation = None
        if "TWF" in names:
            if slip_weakening or rate_and_state:
                nucleation = self._forced(friction.get("law", friction)["mu_s"] if slip_weakening else None)
            else:
                friction = self._time_weakening()
        if stress["cohesion"] != 0.0:
            friction = {"kind": "cohesion", "c": stress["cohesion"], "law": friction}
        friction = self._normal_memory(friction)
        entries: Table = {
            "contact": {"kind": "split_node"}, "initial_stress": self._initial(stress), "friction": friction,
        }  # fmt: skip
        return entries | ({"nucleation": [nucleation]} if nucleation else {})

    def _initial(self, stress: Table) -> Table:
        """Return initial tractions: those given, and those of the stress tensor on a straight fault."""
        tensor = {key: stress[key] for key in STRESSES if stress[key] != 0.0}
        normal, shear = stress["tn"], stress["tt"]
        if tensor:
            if any(isinstance(each, dict) for each in (normal, shear, *tensor.values())):
                raise ConversionError(
                    f"&BC_DYNFLT {', '.join(tensor)}: a stress tensor beside, or with, distributions; write the "
                    "tractions Tn and Tt instead"
                )
            ends = self.line.points[[0, -1]]
            x, z = (ends[1] - ends[0]) / max(abs(ends[1] - ends[0]).max(), 1e-300)
            tx, tz = x / (x * x + z * z) ** 0.5, z / (x * x + z * z) ** 0.5
            nx, nz = -tz, tx
            get = {key: float(tensor.get(key, 0.0)) for key in STRESSES}
            pull_x, pull_z = get["sxx"] * nx + get["sxz"] * nz, get["sxz"] * nx + get["szz"] * nz
            # On an edge of the mesh their normal points out of it, which turns the sign of motion along y.
            across = (get["sxy"] * nx + get["syz"] * nz) * (1 if self.inside else -1)
            shear += across if self.antiplane else pull_x * nz - pull_z * nx
            normal += pull_x * nx + pull_z * nz
        normal = _negative(normal)
        values = normal.get("values", [normal.get("inside", 1), normal.get("outside", 1)]) if isinstance(
            normal, dict) else [normal]  # fmt: skip
        if min(values) <= 0:
            raise ConversionError(
                f"&BC_DYNFLT Tn = {0.0 - min(values):g}: must be negative, compression, everywhere on the fault"
            )
        if not self.inside:
            self.given.note(
                "the fault at the edge is the middle of two equal plates that shear each other"
                + ("; displacements of receivers have the other sign" if self.antiplane else "")
            )
        return {"normal": normal, "shear": shear}

    def _slip_weakening(self) -> Table:
        block = self.of("BC_DYNFLT_SWF")[0]
        values = self.values("BC_DYNFLT_SWF", {"D_c": ("dc", 0.5), "mu_s": ("mus", 0.6), "mu_d": ("mud", 0.5)})
        self.given.refuse_keys(block, "strength that heals when slip stops", "healing")
        kinds = {1: "linear_slip_weakening", 2: "exponential_slip_weakening"}
        kind = int(block.number("kind", 1))
        if kind not in kinds:
            self.given.refuse("BC_DYNFLT_SWF.kind", f"kind = {kind}, slip weakening that is not linear or exponential")
        law = {"kind": kinds.get(kind, kinds[1]), **values}
        drag = value(self.given, block, "alpha", 0.0, self.of("BC_DYNFLT_SWF")[1], self.line)
        return law if drag == 0.0 else {"kind": "roughness_drag", "drag": drag, "law": law}

    def _rate_and_state(self, slip_rate: float | Table) -> Table:
        """Return a rate-and-state law; its state is given, or carries the initial stress at the initial slip rate."""
        block = self.of("BC_DYNFLT_RSF")[0]
        values = self.values(
            "BC_DYNFLT_RSF",
            {"D_c": ("dc", 0.5), "f_0": ("mus", 0.6), "a": ("a", 0.01), "b": ("b", 0.02), "V_0": ("vstar", 1.0),
             "theta_initial": ("theta", 0.0), "V_c": ("vc", 1e-6)},
        )  # fmt: skip
        theta, cut_off, kind = values.pop("theta_initial"), values.pop("V_c"), int(block.number("kind", 1))
        kinds = {2: "rate_and_state_ageing", 3: "rate_and_state_slip", 4: "rate_and_state_saturating"}
        if kind == 1:
            if theta != 0.0:
                self.given.refuse("BC_DYNFLT_RSF.theta", "an initial state of velocity weakening other than zero")
            weakening = {"mu_s": values.pop("f_0"), "V_w": values.pop("V_0"), **values}
            return {"kind": "rate_and_state_velocity_weakening", **weakening}
        if kind not in kinds:
            raise ConversionError(f"&BC_DYNFLT_RSF kind = {kind}: must be 1, 2, 3 or 4")
        state = {"V_initial": slip_rate} if theta == 0.0 else {"theta_initial": theta}
        if kind == 4:
            if isinstance(values["D_c"], dict) or isinstance(cut_off, dict):
                raise ConversionError(
                    "&BC_DYNFLT_RSF kind = 4: Dc and Vc must be numbers; replace their distributions by one value"
                )
            state["theta_c"] = values["D_c"] / cut_off
        return {"kind": kinds[kind], **values, **state}

    def _front(self) -> tuple[Block, float, float, float]:
        """Return the block of time weakening, its center, the start of its front and the time of weakening."""
        block = self.of("BC_DYNFLT_TWF")[0]
        center, distance = self.line.locate((block.number("x", 0.0), block.number("z", 0.0)))
        if distance > 1e-6 * (self.line.positions[-1] - self.line.positions[0]):
            raise ConversionError(
                f"&BC_DYNFLT_TWF X, Z = {block.number('x', 0.0):g}, {block.number('z', 0.0):g}: {distance:g} m away "
                "from the fault; move the hypocenter onto it"
            )
        speed, width = block.number("v", 1e3), block.number("l", 1.0)
        mu_s, mu_d, mu_0 = (block.number(key, default) for key, default in (("mus", 0.6), ("mud", 0.5), ("mu0", 0.6)))
        early = (mu_s - mu_0) / (mu_s - mu_d) * width / speed if block.number("kind", 1) == 1 else 0.0
        return block, center, -early, width / speed

    def _forced(self, strength: object) -> Table:
        """Return time weakening beside another law as a nucleation."""
        block, center, start, duration = self._front()
        kind, last = int(block.number("kind", 1)), block.number("t", HUGE)
        if kind == 2:
            self.given.refuse("BC_DYNFLT_TWF.kind", "kind = 2, a front that slows down and returns")
        mu_s, mu_d, speed = block.number("mus", 0.6), block.number("mud", 0.5), block.number("v", 1e3)
        if strength is not None and strength != mu_s:
            self.given.note(f"time weakening begins at the strength of the law, not at MuS = {mu_s:g}")
        extent = self.line.positions[-1] - self.line.positions[0]
        forced: Table = {
            "kind": "forced_rupture", "center": center, "speed": speed, "mu_d": mu_d, "t_w": duration, "start": start,
            "radius": min(speed * last, extent) if kind == 3 else extent,
        }  # fmt: skip
        if kind == 1 and last < HUGE:
            forced["end"] = last + start
        if "dc" in block.values:
            self.given.note(f"time weakening does not end at the slip Dc = {block.number('dc'):g} m")
        return forced

    def _time_weakening(self) -> Table:
        block, center, start, duration = self._front()
        if block.number("kind", 1) != 1 or "t" in block.values:
            self.given.refuse("BC_DYNFLT_TWF.kind", "time weakening alone that ends, or whose front changes its speed")
        mu_s, mu_d = block.number("mus", 0.6), block.number("mud", 0.5)
        if start:
            raise ConversionError(
                f"&BC_DYNFLT_TWF Mu0 = {block.number('mu0', 0.6):g}: must be MuS = {mu_s:g} where time weakening is "
                "the only law"
            )
        arrival: Table = {"kind": "cone", "slope": 1 / block.number("v", 1e3), "center": center}
        return {"kind": "time_weakening", "mu_s": mu_s, "mu_d": mu_d, "arrival": arrival, "t_w": duration}

    def _normal_memory(self, friction: Table) -> Table:
        block = self.of("BC_DYNFLT_NOR")[0]
        kind = int(block.number("kind", 1))
        if kind == 2:
            return {"kind": "memory_constant_time", "t_c": block.number("t", 1.0), "law": friction}
        if kind == 3:
            memory: Table = {"L_p": block.number("l", 1.0), "V_star": block.number("v", 1.0)}
            return {"kind": "prakash_clifton", **memory, "law": friction}
        if kind != 1:
            raise ConversionError(f"&BC_DYNFLT_NOR kind = {kind}: must be 1, 2 or 3")
        return friction


def _negative(stress: float | Table) -> float | Table:
    """Return minus a number or a profile."""
    if not isinstance(stress, dict):
        return -stress
    turned = {key: -stress[key] for key in ("inside", "outside", "background", "amplitude") if key in stress}
    return stress | turned | ({"values": [-each for each in stress["values"]]} if "values" in stress else {})
