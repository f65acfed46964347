"""A case: everything one run needs, strict and cross-checked; TOML in, `--set` overrides."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self, cast

import numpy as np
from pydantic import Field, ModelWrapValidatorHandler, ValidationError, ValidationInfo, field_validator, model_validator

from ruptfx import Table
from ruptfx.bodies.boundaries import AnyBoundary, Boundary
from ruptfx.bodies.initial_stress import AnyBodyStress, Component, matrices
from ruptfx.bodies.meshes import AnyMesh
from ruptfx.case import consistency, support
from ruptfx.input.former_names import warn_of_former
from ruptfx.input.plugins import CaseFile, active, named
from ruptfx.input.quantities import require_units, si_and_units
from ruptfx.input.schema import (
    ONE_OR_SEVERAL,
    Alternative,
    CaseError,
    Name,
    Part,
    Unit,
    check_tables,
    find,
    json_schema,
    kinds,
    load_toml,
    load_toml_file,
    nearest,
    package_of,
    set_key,
    shown_key,
    unit_of_key,
    value_at,
)
from ruptfx.input.units import Duration, Fraction, Length, Rate, Speed, Time, VaryingGap
from ruptfx.interfaces.attachments import AnyAttachment
from ruptfx.interfaces.collisions import AnyCollisions
from ruptfx.interfaces.cracks import AnyFracture
from ruptfx.interfaces.faults.initial_stress import InitialStress
from ruptfx.interfaces.pore_pressure import AnyPorePressure
from ruptfx.interfaces.sliding import Sliding
from ruptfx.interfaces.slip_histories import AnySlipHistory
from ruptfx.interfaces.temperature import AnyTemperature
from ruptfx.laws.cohesion import AnyCohesion
from ruptfx.laws.contact import AnyContact
from ruptfx.laws.friction import AnyFriction, FrictionLaw
from ruptfx.laws.friction.coulomb import Coulomb
from ruptfx.laws.materials import AnyMaterial, Material, Plane
from ruptfx.laws.nucleation import AnyNucleation
from ruptfx.platform.codegen import native
from ruptfx.readings.instruments import AnyInstrument, with_stations
from ruptfx.readings.misfits import AnyMisfit, Inference, Reconstruction, Unknown
from ruptfx.results.cameras import AnyCamera
from ruptfx.stepping.steppers import AnyStepper
from ruptfx.stepping.stopping import StopWhen

if TYPE_CHECKING:
    from ruptfx.lumped import LumpedModel

FOLDERS = [
    "meshes", "materials", "contact", "friction", "cohesion", "cracks", "collisions", "nucleation", "boundaries",
    "attachments", "steppers", "instruments", "misfits", "profiles", "phases", "cameras", "initial_stress",
    "stop_rules", "slip_histories", "pore_pressure", "temperature",
]  # fmt: skip


RECORDS = {"solid": 60}
"""Interface records of a run by default where it is not 300: those of a surface are large."""


class FaultCase(Part):
    """One interface of the mesh: contact method, friction law, initial state."""

    contact: AnyContact
    """Contact method for opening and slip."""
    friction: AnyFriction | None = None
    """Friction law; only an interface with prescribed slip needs none, and then has no other slip."""
    prescribed_slip: Annotated[list[AnySlipHistory], ONE_OR_SEVERAL] = []
    """Slip that is given in space and time, in place of friction; the slips of several entries add up."""
    cohesion: AnyCohesion | None = None
    """Cohesive law in tension and shear, in addition to friction."""
    initial_stress: InitialStress = InitialStress()
    """Initial stress of the interface; without it that of the bodies, `[initial_stress]`."""
    gap: VaryingGap | None = None
    """Initial gap between the two sides; the initial normal stress is zero where it is open."""
    sliding: Sliding | None = None
    """Finite sliding: with this table, even an empty one, the two sides may slide any distance, and their meshes
    need not match."""
    nucleation: Annotated[list[AnyNucleation], ONE_OR_SEVERAL] = []
    """Nucleation of the rupture; entries act together."""
    pore_pressure: Annotated[list[AnyPorePressure], ONE_OR_SEVERAL] = []
    """Pore pressure, subtracted from the normal stress in the friction law; entries add up."""
    temperature: Annotated[list[AnyTemperature], ONE_OR_SEVERAL] = []
    """Temperature of the interface, which friction laws may read; entries add up."""

    @field_validator("nucleation", "prescribed_slip", "pore_pressure", "temperature", mode="before")
    @classmethod
    def _as_list(cls, value: object) -> object:
        return [value] if isinstance(value, dict) else value

    @model_validator(mode="after")
    def _rubs_or_slips(self) -> Self:
        if self.friction is None and not self.prescribed_slip:
            raise ValueError("friction: missing; give a law, or all of the slip in prescribed_slip")
        if self.friction is None and self.nucleation:
            raise ValueError(
                "nucleation: loads or weakens friction, and there is no law; give friction, too, or remove it"
            )
        return self

    def fields(self) -> Iterator[tuple[str, type[Part]]]:
        """Yield the fields of the interface that the case gives, with the class of an entry that follows the motion."""
        for name in ("pore_pressure", "temperature"):
            if entries := getattr(self, name):
                yield name, next((type(each) for each in entries if each.follows_motion), type(self))

    @property
    def law(self) -> FrictionLaw:
        """The friction law; one without effect where all slip is prescribed."""
        return Coulomb(mu_d=0.0) if self.friction is None else self.friction


def _with_fluid(fault: object) -> object:
    """Return the table of an interface with a pore pressure around its law, in place of `pressurised`."""
    while isinstance(fault, Mapping) and isinstance(law := fault.get("friction"), Mapping):
        if law.get("kind") != "pressurised" or fault.get("sliding") is not None:
            break
        warn_of_former("of friction the kind", "pressurised", "pore_pressure.given")
        fluid = {"begin": 0.0, **{key: value for key, value in law.items() if key != "law"}, "kind": "given"}
        others = fault.get("pore_pressure", [])
        others = [others] if isinstance(others, Mapping) else others
        fault = {**fault, "friction": law.get("law"), "pore_pressure": [*others, fluid]}
    return fault


Velocity = Annotated[list[float], Field(min_length=1, max_length=3), Unit("m/s")]


class Output(Part):
    """Saved data and their intervals; default are 300 interface records, in 3D 60, and 6 bulk snapshots.

    Records are made at the multiples of an interval, and a last one at the duration.
    """

    interface_interval: Duration | None = None
    """Time between records of the interface; duration / 300 without it, in 3D duration / 60."""
    interface_steps: Annotated[int, Field(ge=1)] | None = None
    """Also save the interface every so many steps, for steps of variable length."""
    interface_growth: Annotated[float, Field(gt=1), Unit("1")] | None = None
    """Also save the interface when its largest slip rate has grown or fallen by this factor since the last record, in
    steps without inertia: cycles of a thousand years in some hundred records."""
    forces_interval: Duration | None = None
    """Time between rows of `forces.csv` in finite sliding, which are then means over it, of every step; without
    it, instantaneous values at every record of the interface."""
    bulk_interval: Duration | None = None
    """Time between snapshots of the bodies; duration / 6 without it."""
    bulk_fields: Annotated[
        list[Literal["velocity", "displacement", "stress", "fringe", "state"]], Field(min_length=1)
    ] = ["velocity", "displacement", "stress", "fringe", "state"]
    """Fields of snapshots; `fringe` is sigma_1 - sigma_2 in the plane of x and y, `state` what materials record of
    theirs, such as plastic strain."""
    bulk_precision: Literal["double", "single"] = "double"
    """Precision of the numbers in snapshots: 15 digits, or 7 in half the space."""
    bulk_compression: Annotated[int, Field(ge=0, le=9)] = 0
    """Lossless compression of snapshots: 0 is none, 9 the strongest (gzip)."""
    checkpoint_minutes: Annotated[float, Field(gt=0), Unit("min")] = 10.0
    """Wall-clock time between checkpoints."""
    checkpoint_steps: Annotated[int, Field(ge=1)] | None = None
    """Steps between checkpoints, instead."""
    rupture_threshold: Speed = 1e-3
    """Slip rate whose first passage at a closed point is its rupture time; slower points count as sticking in contact
    states."""
    rupture_after: Time | None = None
    """Time from which on rupture times count; earlier slip or opening, during pressing and shearing, is ignored.
    Default is the first nucleation of the interface that begins after zero, or zero."""
    figures: bool = True
    """Draw figures at the end of a run."""
    plate_thickness: Length | None = None
    """Thickness of the bodies along the light of a polariscope; required for fringes."""


class KelvinVoigt(Part):
    """Viscosity of some elements, by default next to the interfaces: stress = C : (strain + eta strain rate).

    It removes mesh noise behind a sharp front; too much of it delays the front.
    """

    fraction: Fraction = 0.1
    """eta over the stable time step without it; 0.1 to 0.3 (Source: Day et al. 2005)."""
    eta: Duration | None = None
    """Viscosity over modulus, given instead of the fraction."""
    thickness: Length | None = None
    """Elements whose centre is that close to an interface; without it, those that touch one."""
    bodies: list[str] | None = None
    """Bodies that are viscous, all their elements, instead of a layer along the interfaces."""
    beta_2: Annotated[float, Field(gt=0.5, lt=1), Unit("1")] | None = None
    """Numerical damping of explicit Newmark steps with gamma = beta_2, instead: eta is (beta_2 - 1/2) times the time
    step, in all elements. In linear bodies both are the same scheme, whose stable step is sqrt(1 / (2 beta_2)) times
    that without damping; tractions of interfaces are not damped."""

    @model_validator(mode="after")
    def _one_viscosity(self) -> KelvinVoigt:
        beside = [name for name in ("fraction", "eta", "thickness", "bodies") if name in self.model_fields_set]
        if self.beta_2 is not None and beside:
            raise ValueError(f"beta_2 = {self.beta_2:g}: sets the viscosity of all bodies; remove {', '.join(beside)}")
        if self.eta is not None and self.fraction != type(self).model_fields["fraction"].default:
            raise ValueError(
                f"fraction = {self.fraction:g}: without effect beside eta = {self.eta:g} s; remove one of them"
            )
        if self.bodies is not None and self.thickness is not None:
            raise ValueError("bodies, thickness: give one of them")
        return self


class Damping(Part):
    """Damping of the bodies."""

    needs: ClassVar[frozenset[str]] = frozenset({"inertia"})

    mass: Rate = 0.0
    """Force per mass and velocity."""
    kelvin_voigt: KelvinVoigt | None = None
    """Viscosity next to the interfaces, against the noise behind sharp fronts."""


class Stage(Part):
    """A stage of loading; keys without a value are those of the case."""

    duration: Duration
    """Duration of the stage; those of all stages add up to the duration of the case."""
    boundaries: list[AnyBoundary] | None = None
    """Boundaries of the stage, with times since its start. A boundary of the previous stage that continues changes over
    its ramp from its current to its new amount."""
    damping: Damping | None = None
    """Damping instead."""


class Case(CaseFile):
    """A complete case of a run.

    Raises
    ------
    CaseError
        For any invalid input; the message gives the key, its value and the remedy.
    """

    title: str = ""
    """Title of figures and tables."""
    plane: Plane
    """Plane stress, plane strain, antiplane shear (motion in z only), a solid in three dimensions, or `axisymmetric`,
    the section of bodies of revolution about y = 0: y is the radius."""
    order: Annotated[int, Field(ge=1, le=8)] = 4
    """Polynomial order of the spectral elements."""
    operator: str = "matrix_free"
    """Application of the stiffness: `matrix_free` is fastest, for linear elasticity; `ufl_form` is for all."""
    precision: Literal["double", "single"] = "double"
    """Numbers of the bodies in explicit steps: with `single`, velocities, forces, masses and moduli have 4 bytes, while
    displacements, interfaces and sums of energies stay double. Steps take 0.7 to 0.9 of the time."""
    duration: Duration
    """Simulated time."""
    large_rotations: bool = False
    """Allow rotations by any angle: strains are then those of Biot, U - 1 of 1 + grad u = R U, which a rotation
    does not change; Hooke's law for small strains is the same. In the plane, in explicit steps, without faults."""
    positions: Literal["x"] | None = None
    """Positions along interfaces on x are x. Required where positions are given and such an interface does not begin
    at x = 0: until version 0.1 they were lengths from its left end."""
    mesh: AnyMesh
    """Shape, size and elements of the bodies."""
    materials: dict[Name, AnyMaterial]
    """Materials by body; `default` is for the bodies not listed. A name stands for constants, such as `pmma`; see
    `ruptfx describe materials`."""
    initial_stress: AnyBodyStress | None = None
    """Initial stress of the bodies, a tensor, which may vary with depth: the tractions of interfaces and the initial
    stress of yielding materials follow from it where they give none."""
    faults: dict[Name, FaultCase] = {}
    """Interfaces by name; that of generated meshes is `main`."""
    fracture: AnyFracture | None = None
    """Fracture of the bodies along the facets of a mesh of triangles."""
    collisions: AnyCollisions | None = None
    """Contact between bodies and fragments that were not neighbours; without it they pass through each other."""
    initial_velocity: dict[Name, Velocity] = {}
    """Initial velocity by body, in explicit steps; other bodies are at rest."""
    boundaries: list[AnyBoundary] = []
    """Conditions and loads on edges and inside of the bodies, an entry each; edges that are not named are free."""
    damping: Damping = Damping()
    """Damping of the bodies; none without it."""
    stepper: AnyStepper = Field(default={"kind": "leapfrog"}, validate_default=True)
    """Time stepper; keys without `kind` are those of `leapfrog`."""
    output: Output = Output()
    """Saved data and their intervals."""
    attachments: list[AnyAttachment] = []
    """Masses, springs and ground attached to edges, an entry each."""
    instruments: list[AnyInstrument] = []
    """Measurements during the run, an entry each: receivers, velocimeters, strain gauges, load cells."""
    objective: list[AnyMisfit] = []
    """Function of the readings of a run that `ruptfx gradient` differentiates, the sum of its entries."""
    unknowns: list[Unknown] = []
    """Quantities by which it is differentiated, an entry each; all that the case has without any."""
    inference: Inference | None = None
    """Search of `ruptfx infer` for the unknowns from the data of the objective; default settings without it."""
    reconstruction: Reconstruction | None = None
    """Prior of `ruptfx reconstruct`, which finds the slip of the interface from the data; defaults without it."""
    cameras: list[AnyCamera] = []
    """Cameras whose films `ruptfx film` makes from the snapshots of the run, an entry each."""
    stages: list[Stage] = []
    """Successive stages with other boundaries and damping: press, hold, shear."""
    stop_when: StopWhen | None = None
    """Rules that stop the run before its duration."""

    @model_validator(mode="before")
    @classmethod
    def _fluids_of_friction(cls, values: object) -> object:
        """Read the former friction law `pressurised` as a pore pressure, where interfaces have one."""
        faults = values.get("faults") if isinstance(values, Mapping) else None
        if not isinstance(values, Mapping) or not isinstance(faults, Mapping) or values.get("fracture") is not None:
            return values
        return {**values, "faults": {name: _with_fluid(fault) for name, fault in faults.items()}}

    @model_validator(mode="before")
    @classmethod
    def _of_the_only_interface(cls, values: object) -> object:
        """Give instruments and terms that name no interface the only one of the case, whatever its name."""
        faults = values.get("faults") if isinstance(values, Mapping) else None
        if not isinstance(values, Mapping) or not isinstance(faults, Mapping) or len(faults) != 1 or "main" in faults:
            return values
        named = {"fault": next(iter(faults))}

        def completed(entry: object, folder: str) -> object:
            kind = entry.get("kind") if isinstance(entry, Mapping) else None
            takes_one = kind in kinds(folder) and "fault" in find(folder, str(kind)).model_fields
            return {**named, **entry} if takes_one and isinstance(entry, Mapping) else entry

        folders = {"instruments": "ruptfx.readings.instruments", "objective": "ruptfx.readings.misfits"}
        return {**values, **{
            key: [completed(each, folder) for each in values[key]] for key, folder in folders.items()
            if isinstance(values.get(key), list)
        }}  # fmt: skip

    @model_validator(mode="wrap")
    @classmethod
    def _units_of_unknowns(cls, values: object, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Read bounds and deviations of unknowns in the unit of their key, which is known with the case."""
        listed = values.get("unknowns") if isinstance(values, Mapping) else None
        if not isinstance(values, Mapping) or not isinstance(listed, list):
            return handler(values)
        unknowns, value = [], []
        for number, unknown in enumerate(listed):
            changes = {}
            for name in ("bounds", "sigma") if isinstance(unknown, Mapping) else ():
                if name in unknown and not (name == "sigma" and unknown.get("scale") == "log"):
                    changes[name], units = si_and_units(unknown[name])
                    value.append((f"unknowns.{number}.{name}", units, str(unknown.get("key"))))
            unknowns.append({**unknown, **changes} if changes else unknown)
        case = handler({**values, "unknowns": unknowns})
        for key, units, of in value:
            require_units(key, units, unit_of_key(case, of))
        return case

    @field_validator("instruments", mode="before")
    @classmethod
    def _one_for_each_station(cls, entries: object, info: ValidationInfo) -> object:
        return with_stations(entries, info)

    @field_validator("stepper", mode="before")
    @classmethod
    def _leapfrog_unless_said(cls, value: object) -> object:
        return {"kind": "leapfrog", **value} if isinstance(value, dict) else value

    @field_validator("operator")
    @classmethod
    def _operator_exists(cls, name: str) -> str:
        if name not in kinds("ruptfx.bodies.operators"):
            raise ValueError(f"no such operator, {nearest(name, kinds('ruptfx.bodies.operators'))}")
        return name

    @model_validator(mode="after")
    def _consistent(self) -> Case:
        if problems := consistency.problems(self):
            raise ValueError("\n".join(problems))
        support.check(self.choices(), self._shown)
        for text in consistency.without_effect(self):
            raise CaseError(text)
        return self

    @property
    def real(self) -> np.dtype:
        """Type of the velocities and forces of the bodies in steps."""
        return native.SINGLE if self.precision == "single" else native.DOUBLE

    def choices(self) -> support.Choices:
        """Return all parts of the case that some rule of `ruptfx.case.support` needs, by key."""
        choices: dict[str, type[Part]] = {"stepper": type(self.stepper), support.PLANE + self.plane: type(self)}
        choices |= {f"materials.{name}": type(material) for name, material in self.materials.items()}
        for name, material in self.materials.items():
            choices |= {f"materials.{name}.{key.partition('.')[0]}": type(self) for key in material.varying}
        for name, fault in self.faults.items():
            for field in ("contact", "cohesion", "sliding"):
                if (part := getattr(fault, field)) is not None:
                    choices[f"faults.{name}.{field}"] = type(part)
            if fault.gap is not None:
                choices[f"faults.{name}.gap"] = type(fault)
            if fault.prescribed_slip:
                choices[f"faults.{name}.prescribed_slip"] = type(fault)
            choices |= {f"faults.{name}.{field}": cls for field, cls in fault.fields()}
        if self.mesh.along_strike is not None:
            choices["mesh.along_strike"] = type(self.mesh.along_strike)
        choices |= {key: type(boundary) for key, boundary in self.all_boundaries()}
        choices |= {f"attachments.{number}": type(each) for number, each in enumerate(self.attachments)}
        for key, damping in self.all_dampings():
            fields = type(damping).model_fields.items()
            items = (name for name, field in fields if getattr(damping, name) != field.default)
            choices |= {f"{key}.{name}": type(damping) for name in items}
        for name in ("fracture", "collisions"):
            if (part := getattr(self, name)) is not None:
                choices[name] = type(part)
        items = (name for name in ("stages", "large_rotations", "objective") if getattr(self, name))
        choices |= {"precision": type(self)} if self.precision == "single" else {}
        return choices | {name: type(self) for name in items}

    def _shown(self, key: str) -> str:
        """Return a key with its kind or its number as text, as in a case file."""
        if key.startswith(support.PLANE):
            return f"plane = '{key.removeprefix(support.PLANE)}'"
        value = value_at(self, key)
        if isinstance(value, Alternative):
            return f"{key}.kind = '{value.kind()}'"
        return f"{key} = {value:g}" if isinstance(value, float) else key

    @property
    def stressed_materials(self) -> dict[str, Material]:
        """The materials, with the initial stress of the bodies where they yield and give none of their own."""
        value = self.initial_stress
        if value is None:
            return self.materials
        everywhere = value.everywhere
        six = [Component(stress=value, number=i) for i in range(6)] if everywhere is None else everywhere.tolist()
        return {
            name: material.substituted({"initial_stress": six})
            if "initial_stress" in type(material).model_fields else material
            for name, material in self.materials.items()
        }  # fmt: skip

    def all_boundaries(self) -> Iterator[tuple[str, Boundary]]:
        """Yield all boundaries with their keys, also those of stages."""
        for number, boundary in enumerate(self.boundaries):
            yield f"boundaries.{number}", boundary
        for number, stage in enumerate(self.stages):
            for index, boundary in enumerate(stage.boundaries or []):
                yield f"stages.{number}.boundaries.{index}", boundary

    def all_dampings(self) -> Iterator[tuple[str, Damping]]:
        """Yield all dampings with their keys, also those of stages."""
        yield "damping", self.damping
        for number, stage in enumerate(self.stages):
            if stage.damping is not None:
                yield f"stages.{number}.damping", stage.damping

    @property
    def initial_tensor(self) -> np.ndarray | None:
        """Uniform initial stress of the bodies, shape (dim, dim) [Pa]; None if only tractions are given."""
        dim = 3 if self.plane == "solid" else 2
        if self.initial_stress is not None:
            everywhere = self.initial_stress.everywhere
            return None if everywhere is None else matrices(everywhere[None])[0, :dim, :dim]
        items = (fault.initial_stress.matrix(dim) for fault in self.faults.values())
        return next((tensor for tensor in items if tensor is not None), None)

    @property
    def intervals(self) -> dict[str, float]:
        """Time between records [s] of interfaces, bodies, and averaged forces."""
        output = self.output
        entries = {
            "interface": output.interface_interval or self.duration / RECORDS.get(self.plane, 300),
            "bulk": output.bulk_interval or self.duration / 6,
        }
        if self.mesh.along_strike is not None:  # bodies are known at the interfaces only
            del entries["bulk"]
        return entries if output.forces_interval is None else {**entries, "forces": output.forces_interval}

    @property
    def impact_speed(self) -> float:
        """Largest driven velocity [m/s], 0 without driven edges."""
        return max((boundary.largest_speed for _, boundary in self.all_boundaries()), default=0.0)

    @property
    def driven_edges(self) -> list[str]:
        """Edges that are driven fastest; none if all are at rest."""
        speed = self.impact_speed
        moving = (each for _, each in self.all_boundaries() if each.largest_speed == speed > 0)
        return [each.driven_edge for each in moving if each.driven_edge is not None]


def parse_case(table: Table, directory: Path | None = None) -> Case | LumpedModel:
    """Return a case from tables, with paths relative to `directory`; a top-level ``kind`` names a lumped model.

    Raises
    ------
    CaseError
    """
    table = dict(table)
    check_tables(table)
    try:
        if "kind" in table:
            kind = table.pop("kind")
            with active(named(table, directory)):
                if kind not in kinds("ruptfx.lumped"):
                    hint = nearest(str(kind), kinds("ruptfx.lumped"))
                    raise CaseError(f"kind = '{shown_key(kind)}': unknown, {hint}")
                model = cast("type[LumpedModel]", find("ruptfx.lumped", kind))
            return model.model_validate(table, context={"directory": directory})
        return Case.model_validate(table, context={"directory": directory})
    except ValidationError as error:
        raise CaseError.from_validation(error) from None


def read_case(path: str | Path, overrides: Iterable[str] = ()) -> Case | LumpedModel:
    """Read and check a case file.

    Parameters
    ----------
    path : str or Path
        TOML file.
    overrides : iterable of str
        ``"faults.main.initial_stress.normal=30e6"``: dotted key and TOML value.

    Raises
    ------
    CaseError
        File missing, not TOML or a study; unknown keys, wrong types or signs, inconsistent values.
    """
    path = Path(path)
    table = read_toml(path)
    if "axes" in table:
        raise CaseError(f"{path}: a study, not a case; run it with: ruptfx study {shlex.quote(str(path))}")
    for item in overrides:
        override(table, item)
    try:
        return parse_case(table, path.resolve().parent)
    except CaseError as error:
        raise CaseError("\n".join(f"{path}: {line}" for line in str(error).splitlines())) from None


def read_toml(path: Path) -> Table:
    """Return the tables of a TOML file, unchecked.

    Raises
    ------
    CaseError
        File missing, or not TOML.
    """
    if (path / "case.toml").is_file():
        raise CaseError(f"{path}: a run directory; its case is {path / 'case.toml'}, and 'ruptfx resume' continues it")
    return load_toml_file(path)


def override(table: Table, item: str) -> None:
    """Set one dotted key of the tables in place; list entries are addressed by number.

    Raises
    ------
    CaseError
    """
    key, equals, text = item.partition("=")
    if not equals or not key.strip():
        raise CaseError(f"--set {item}: write KEY=VALUE, for example duration=60e-6")
    try:
        value = load_toml(f"value = {text}")["value"]
    except CaseError:
        value = text.strip()  # an unquoted word
    try:
        set_key(table, key.strip(), value)
    except CaseError as error:
        raise CaseError(f"--set {item}: {error}") from None


def case_schema() -> Table:
    """Return the JSON schema of a case file: of a field run, or with a top-level ``kind`` of a lumped model."""
    schema = json_schema(Case, [package_of(folder) for folder in (*FOLDERS, "lumped")])
    definitions = schema.pop("$defs")
    definitions["case"] = schema
    bare = find("ruptfx.stepping.steppers", "leapfrog").model_json_schema()  # as the case reads one without a kind
    stepper = schema["properties"]["stepper"]
    schema["properties"]["stepper"] = {"anyOf": [{"$ref": stepper.pop("$ref")}, bare], **stepper}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema", "title": "ruptfx case",
        "oneOf": [{"$ref": "#/$defs/case"}, {"$ref": "#/$defs/lumped"}], "$defs": definitions,
    }  # fmt: skip
