"""Conversion of SEM2DPACK inputs to cases: a Cartesian box with one horizontal slip-weakening fault.

The reader accepts Fortran namelists, ``&NAME key = value, ... /``, and the numbers after some of them. Unsupported
blocks are refused by name; blocks without influence on the solution (plots, receivers) are skipped with a note.

Source: the users' guide of SEM2DPACK and the descriptions of its input blocks (github.com/jpampuero/sem2dpack).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import tomli_w

from ruptfx import RuptfxError, Table

Value = float | bool | str
LEFT_OUT = ("SNAP", "REC_", "PLOT")
"""Beginnings of blocks that say what is to be shown."""
EDGES = {1: "bottom", 2: "right", 3: "top", 4: "left"}
NAMELIST = re.compile(r"&(\w+)((?:[^'\"/]|'[^']*'|\"[^\"]*\")*)/")
ASSIGNED = re.compile(r"(\w+)\s*=\s*((?:'[^']*'|\"[^\"]*\"|[^='\"])*?)(?=,?\s*\w+\s*=|\s*,?\s*$)")


class ConversionError(RuptfxError):
    """Error of an invalid or unsupported input; names the block and the key."""


@dataclass
class Block:
    """One namelist: its values by key in lower case, and the numbers after it."""

    name: str
    values: dict[str, list[Value]]
    numbers: list[float] = field(default_factory=list)

    def get(self, key: str, default: Value) -> Value:
        """Return the first value of a key."""
        return self.values.get(key, [default])[0]

    def number(self, key: str, default: float | None = None) -> float:
        """Return a number.

        Raises
        ------
        ConversionError
            If it is missing without default, or not a number.
        """
        value = self.values.get(key, [default])[0]
        if isinstance(value, bool | str) or value is None:
            raise ConversionError(f"&{self.name}: {key} is required and must be a number")
        return float(value)

    def pair(self, key: str) -> tuple[float, float]:
        """Return two numbers."""
        found = self.values.get(key, [])
        if len(found) != 2 or not all(isinstance(value, float) for value in found):
            raise ConversionError(f"&{self.name}: {key} is required, two numbers")
        return float(found[0]), float(found[1])

    def refuse(self, *keys: str) -> None:
        """Refuse unsupported keys, unless they have no effect."""
        for key in keys:
            if self.get(key, 0.0) not in (0.0, False, ""):
                value = self.get(key, "")
                raise ConversionError(f"&{self.name}: {key} = {value}: has no counterpart here; write the case")


def convert(text: str, source: str = "Par.inp") -> str:
    """Return the case file; omissions and differences are comments at its head.

    Parameters
    ----------
    text : str
        Content of the input file.
    source : str
        Name of the input file.

    Raises
    ------
    ConversionError
    """
    reader = _Reader(list(blocks(text)))
    table = reader.case()
    head = [f"# From {source} of SEM2DPACK, by: ruptfx convert", *(f"# - {note}" for note in reader.notes)]
    return "\n".join(head) + "\n" + tomli_w.dumps(table)


def convert_file(path: Path) -> str:
    """Return the case file of an input file, as `convert`.

    Raises
    ------
    ConversionError
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise ConversionError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        return convert(text, path.name)
    except ConversionError as error:
        raise ConversionError(f"{path}: {error}") from None


# -- namelists ---------------------------------------------------------------------------------------------------------


def blocks(text: str) -> Iterator[Block]:
    """Yield the namelists of a text in order."""
    text = "\n".join(_without_comment(line) for line in text.splitlines())
    found = list(NAMELIST.finditer(text))
    if not found:
        raise ConversionError("no &NAME ... / block in it; is it an input of SEM2DPACK?")
    for match, following in zip(found, [*found[1:], None], strict=True):
        after = text[match.end() : following.start() if following else None]
        yield Block(match[1].upper(), _values(match[2]), [_number(word) for word in after.split() if _is_number(word)])


def _without_comment(line: str) -> str:
    """Return a line up to # or !, unless quoted."""
    found = re.match(r"(?:[^'\"#!]|'[^']*'|\"[^\"]*\")*", line)
    return found[0] if found else ""


def _values(text: str) -> dict[str, list[Value]]:
    found = {}
    for match in ASSIGNED.finditer(" ".join(text.split())):
        words = re.findall(r"'[^']*'|\"[^\"]*\"|[^,\s]+", match[2])
        found[match[1].lower()] = [value for word in words for value in _repeated(word)]
    return found


def _repeated(word: str) -> list[Value]:
    """Return the values of a Fortran word; 2*0.5 is 0.5 twice."""
    times, star, rest = word.partition("*")
    if star and times.isdigit():
        return [_value(rest)] * int(times)
    return [_value(word)]


def _value(word: str) -> Value:
    if word[0] in "'\"":
        return word[1:-1].strip()
    if re.fullmatch(r"\.?[tf](rue|alse)?\.?", word.lower()):
        return "t" in word.lower()[:2]
    return _number(word) if _is_number(word) else word


def _is_number(word: str) -> bool:
    return re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([edED][-+]?\d+)?,?", word) is not None


def _number(word: str) -> float:
    return float(re.sub("[dD]", "e", word.rstrip(",")))


# -- the case ----------------------------------------------------------------------------------------------------------


class _Reader:
    """Conversion of blocks to a case; `notes` lists the differences."""

    def __init__(self, found: list[Block]) -> None:
        self.found, self.notes = found, []  # type: list[Block], list[str]
        known = {
            "GENERAL", "MESH_DEF", "MESH_CART", "MATERIAL", "MAT_ELASTIC", "MAT_KV", "BC_DEF", "BC_ABSORB", "BC_DIRNEU",
            "BC_PERIODIC", "BC_DYNFLT", "BC_DYNFLT_SWF", "BC_DYNFLT_NOR", "DIST_PWCONR", "TIME", "TIME_NEWMARK",
        }  # fmt: skip
        for block in found:
            if block.name.startswith(LEFT_OUT):
                self.notes.append(f"left out: &{block.name}")
            elif block.name not in known:
                raise ConversionError(f"&{block.name}: only {', '.join(sorted(known))} are read; write the case")

    def one(self, name: str, required: bool = True) -> Block:
        """Return the block of a name that must occur once."""
        same = [block for block in self.found if block.name == name]
        if len(same) > 1 or (required and not same):
            raise ConversionError(f"&{name}: is there {len(same)} times instead of once")
        return same[0] if same else Block(name, {})

    def case(self) -> Table:
        general, time = self.one("GENERAL"), self.one("TIME")
        components = int(general.number("ndof", 2))
        if "w" in general.values:
            raise ConversionError("&GENERAL: W: 2.5 dimensions have no counterpart here")
        self._box(self.one("MESH_CART"))
        material = self._material()
        faults, boundaries = self._boundaries(components)
        table: Table = {
            "title": str(general.get("title", "")), "plane": "antiplane" if components == 1 else "strain",
            "order": int(general.number("ngll", 9)) - 1, "duration": self._duration(time), "positions": "x",
            "mesh": self._mesh, "materials": {"default": material}, **self._stepper(time),
        }  # fmt: skip
        viscosity = self.one("MAT_KV", required=False)
        if viscosity.values:
            viscosity.refuse("etah")
            table["damping"] = {"kelvin_voigt": {"fraction": viscosity.number("eta", 0.1)}}
            self.notes.append(
                "Kelvin-Voigt: eta over the stable step instead of the step, in the elements at the fault only"
            )
        return {**table, "faults": faults, "boundaries": boundaries}

    def _box(self, box: Block) -> None:
        """Set mesh and names of edges: the fault becomes y = 0."""
        if str(self.one("MESH_DEF").get("method", "")).upper() != "CARTESIAN":
            raise ConversionError("&MESH_DEF: method: only 'CARTESIAN' is read; give other meshes as gmsh_file")
        box.refuse("fztag", "split")
        (left, right), (low, high) = box.pair("xlim"), box.pair("zlim")
        columns, rows = box.pair("nelem")
        width, height = (right - left) / columns, (high - low) / rows
        if abs(height - width) > 0.01 * width:
            raise ConversionError(
                f"&MESH_CART: nelem: elements of {width:g} by {height:g} m; here they are squares, so change nelem"
            )
        cut = -1.0 if box.get("faultx", False) else box.number("ezflt", 0)
        below = rows // 2 if cut < 0 else cut
        self._split = below > 0
        if self._split and 2 * below != rows:
            raise ConversionError("&MESH_CART: ezflt: the fault must be in the middle; bodies here are equally high")
        self._fault_z = low + below * height
        if self._fault_z != 0:
            self.notes.append(f"the fault at z = {self._fault_z:g} m is y = 0 here")
        self._mesh: Table = {
            "kind": "two_plates" if self._split else "half_plate", "left": left, "length": right - left,
            "height": (high - low) / (2 if self._split else 1), "element_size": width,
        }  # fmt: skip

    def _material(self) -> Table:
        names = [str(value).upper() for value in self.one("MATERIAL").values.get("kind", ["ELAST"]) if value]
        if set(names) - {"ELAST", "KV"}:
            raise ConversionError(f"&MATERIAL: kind = {', '.join(names)}: only 'ELAST' and 'KV' are read")
        block = self.one("MAT_ELASTIC")
        block.refuse("rhoh", "cph", "csh", "c11")
        keys = {"density": "rho", "c_p": "cp", "c_s": "cs"}
        return {"kind": "isotropic_elastic"} | {ours: block.number(theirs) for ours, theirs in keys.items()}

    def _boundaries(self, components: int) -> tuple[Table, list[Table]]:
        faults: Table = {}
        boundaries: list[Table] = []
        for place, block in enumerate(self.found):
            if block.name != "BC_DEF":
                continue
            tags = [int(float(tag)) for tag in block.values.get("tags", block.values.get("tag", []))]
            kind, own = str(block.get("kind", "")).upper(), self._following(place)
            if kind == "DYNFLT":
                if tags != ([5, 6] if self._split else [1]):
                    raise ConversionError(f"&BC_DEF: tags = {tags}: a fault is at 5,6 inside of the box, or at 1")
                faults["main"] = self._fault(own, components)
            elif kind == "ABSORB":
                boundaries += [{"kind": "absorbing", "edge": edge} for edge in self._edges(tags)]
                if own and own[0].get("stacey", False):
                    self.notes.append("absorbing edges are Lysmer's dashpots, also where stacey = T")
            elif kind == "DIRNEU":
                boundaries += self._held(own[0] if own else Block("BC_DIRNEU", {}), self._edges(tags), components)
            elif kind in ("PERIOD", "PERIODIC") and sorted(tags) == [2, 4]:
                for body in self._bodies:
                    boundaries.append({"kind": "periodic", "first": f"{body}.left", "second": f"{body}.right"})
            else:
                raise ConversionError(f"&BC_DEF: kind = '{kind}' at tags {tags}: has no counterpart here")
        if not faults:
            raise ConversionError("&BC_DEF: no fault, kind = 'DYNFLT', is in it")
        return faults, boundaries

    def _following(self, place: int) -> list[Block]:
        """Return the blocks that belong to the boundary at an index."""
        own = []
        for block in self.found[place + 1 :]:
            if not block.name.startswith(("BC_", "DIST_")) or block.name == "BC_DEF":
                break
            own.append(block)
        return own

    @property
    def _bodies(self) -> list[str]:
        return ["upper", "lower"] if self._split else ["upper"]

    def _edges(self, tags: list[int]) -> list[str]:
        found = []
        for tag in tags:
            if tag not in EDGES or (tag == 1 and not self._split):
                raise ConversionError(f"&BC_DEF: tag = {tag}: edges of this box are 1 to 4, or 2 to 4 above a fault")
            bodies = {1: ["lower"], 3: ["upper"]}.get(tag, self._bodies)
            found += [f"{body}.{EDGES[tag]}" for body in bodies]
        return found

    def _held(self, block: Block, edges: list[str], components: int) -> list[Table]:
        """Return boundaries with zero motion; free components need none."""
        block.refuse("hsrc", "vsrc", "hstf", "vstf")
        names = {"h": "z"} if components == 1 else {"h": "x", "v": "y"}
        held = [ours for theirs, ours in names.items() if str(block.get(theirs, "N")).upper() == "D"]
        return [
            {"kind": "driven", "edge": edge, "component": component, "velocity": 0.0}
            for edge in edges for component in held
        ]  # fmt: skip

    def _fault(self, own: list[Block], components: int) -> Table:
        by_name = {block.name: block for block in own}
        fault, law = by_name.get("BC_DYNFLT", Block("BC_DYNFLT", {})), by_name.get("BC_DYNFLT_SWF", Block("", {}))
        names = [name for name in fault.values.get("friction", ["SWF"]) if name]
        if names != ["SWF"]:
            raise ConversionError(f"&BC_DYNFLT: friction = {names}: only 'SWF' is read; see the laws of this program")
        fault.refuse("sxx", "sxy", "sxz", "syz", "szz", "sxxh", "sxyh", "sxzh", "syzh", "szzh", "cohesionh", "tnh")
        if not fault.get("opening", True):
            raise ConversionError("&BC_DYNFLT: opening = F: an interface that pulls has no counterpart here")
        law.refuse("healing", "alpha", "alphah")
        if by_name.get("BC_DYNFLT_NOR", Block("", {})).number("kind", 1) != 1:
            raise ConversionError("&BC_DYNFLT_NOR: kind: only 1 is read; prakash_clifton is what you look for")
        kinds = {1: "linear_slip_weakening", 2: "exponential_slip_weakening"}
        kind = int(law.number("kind", 1))
        if kind not in kinds:
            raise ConversionError(f"&BC_DYNFLT_SWF: kind = {kind}: only 1 and 2 are read")
        shapes = iter([block for block in own if block.name == "DIST_PWCONR"])
        initial: Table = {
            "normal": -fault.number("tn", 0.0), "shear": self._varying(fault, "tt", 0.0, shapes)
        }  # fmt: skip
        if initial["normal"] <= 0:
            raise ConversionError("&BC_DYNFLT: Tn: must be negative, which is compression")
        friction: Table = {
            "kind": kinds[kind], "D_c": self._varying(law, "dc", 0.5, shapes),
            "mu_s": self._varying(law, "mus", 0.6, shapes), "mu_d": self._varying(law, "mud", 0.5, shapes),
        }  # fmt: skip
        if fault.number("cohesion", 0.0):
            friction = {"kind": "cohesion", "c": fault.number("cohesion"), "law": friction}
        if fault.number("otd", 0.0):
            self.notes.append(f"otd: set output.interface_interval = {fault.number('otd'):g} if you want these times")
        if not self._split and components == 2:
            self.notes.append("the fault at the bottom is the middle of two equal plates that shear each other")
        return {"contact": {"kind": "split_node"}, "initial_stress": initial, "friction": friction}

    def _varying(self, block: Block, key: str, default: float, shapes: Iterator[Block]) -> float | Table:
        """Return a number, or a patch if the key with H names a distribution."""
        shape = str(block.get(f"{key}h", "")).upper()
        if not shape:
            return block.number(key, default)
        around = next(shapes, None) if shape == "PWCONR" else None
        if around is None or len(around.numbers) != 3:
            raise ConversionError(f"&{block.name}: {key}H = '{shape}': only 'PWCONR' with num = 2 is read")
        centre = [float(value) for value in around.values.get("ref", [0.0, 0.0])]
        if len(centre) > 1 and centre[1] != self._fault_z:
            raise ConversionError(f"&DIST_PWCONR: ref: z = {centre[1]:g} m is not on the fault at {self._fault_z:g} m")
        radius, inside, outside = around.numbers
        return {"kind": "boxcar", "center": centre[0], "half_width": radius, "inside": inside, "outside": outside}

    def _duration(self, time: Block) -> float:
        if "totaltime" in time.values:
            return time.number("totaltime")
        return time.number("nbsteps") * time.number("dt")

    def _stepper(self, time: Block) -> Table:
        kind = str(time.get("kind", "leapfrog")).lower()
        if kind not in ("leapfrog", "newmark"):
            raise ConversionError(f"&TIME: kind = '{kind}': only leapfrog and newmark are read")
        if kind == "newmark":
            self.notes.append("newmark is leapfrog here")
        if "dt" in time.values:
            return {"stepper": {"time_step": time.number("dt")}}
        self.notes.append("courant: left out; the time step is 0.9 of the stable one, which is computed")
        return {}
