"""Strict parts, alternatives by file name, units of fields; starting ranks."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest
from helpers.crack_cases import block
from helpers.messages import facts, says
from helpers.small_cases import SPLIT, plates
from pydantic import ValidationError

import ruptfx
from ruptfx import RuptfxError
from ruptfx.app.commands._shared import reported
from ruptfx.app.reference.describe import TOPICS, entries, file_schema
from ruptfx.case import FOLDERS, parse_case
from ruptfx.input.former_names import FormerName, warn_of_former
from ruptfx.input.schema import CaseError, alternatives, directory_of, find, kinds, nearest, package_of, unit_of
from ruptfx.interfaces.collisions.potential import Potential
from ruptfx.interfaces.sliding import Sliding
from ruptfx.laws.cohesion import CohesiveLaw
from ruptfx.laws.friction.coulomb import Coulomb
from ruptfx.laws.friction.rate_and_state_ageing import RateAndStateAgeing
from ruptfx.platform import launch
from ruptfx.stepping.steppers.leapfrog import Leapfrog


@pytest.mark.parametrize("folder", FOLDERS)
def test_the_file_name_is_the_kind(folder: str) -> None:
    found = alternatives(package_of(folder))
    shared = getattr(sys.modules[package_of(folder)], "SHARED", ())
    files = {path.stem for path in directory_of(folder).glob("*.py") if not path.stem.startswith("_")}
    assert set(shared) <= files and set(found) == files - set(shared)
    for kind, cls in found.items():
        assert cls.kind() == kind and cls.summary()
        # The class is the file name in CamelCase.
        assert cls.__name__.lower() == kind.replace("_", "")


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_number_that_has_a_unit_says_so(folder: str) -> None:
    symbol = "(1|m|s|kg|Pa|N|J|rad|degree|K)[2-4]?"
    unit = re.compile(f"{symbol}( {symbol})*(/{symbol})*")  # of the SI: "1/s", "N m", "kg/m3"
    for cls in alternatives(package_of(folder)).values():
        for name in cls.model_fields:
            assert unit.fullmatch(unit_of(cls, name)), f"{cls.__name__}.{name} [{unit_of(cls, name)}]"


def test_every_key_is_described() -> None:
    """Also those that a new file of any folder brings: its attributes need docstrings."""
    todo, found, missing = [("", file_schema())], 0, []
    while todo:
        where, node = todo.pop()
        for key, value in node.get("properties", {}).items():
            found += 1
            if len(value.get("description", "").split()) < 2:
                missing.append(f"{where}.{key}")
        for key, value in node.items():
            for item in value if isinstance(value, list) else [value]:
                if isinstance(item, dict):
                    todo.append((f"{where}.{item.get('title', key)}", item))
    assert found > 400
    assert not missing


def test_every_table_is_described_somewhere() -> None:
    """Tables of the schema that are no folder of alternatives: each is an entry of a topic, with the same keys."""
    shown = [{key.name for key in entry.keys} for topic in TOPICS if topic != "operators" for entry in entries(topic)]
    schema = file_schema()["$defs"]
    for name, table in schema.items():
        keys = set(table.get("properties", {})) - {"kind"}
        assert not keys or keys in shown, name


def test_units_are_found() -> None:
    assert unit_of(Coulomb, "mu_d") == "1"
    assert unit_of(RateAndStateAgeing, "D_c") == "m" and unit_of(RateAndStateAgeing, "V_0") == "m/s"
    # Optional fields too.
    assert unit_of(RateAndStateAgeing, "theta_initial") == "s" and unit_of(Leapfrog, "time_step") == "s"


NO_FRICTION = "Case.faults.main: friction: missing; give a law, or all of the slip in prescribed_slip"


def test_copies_are_checked_too() -> None:
    case = parse_case(plates())
    for changes, message in (
        ({"duration": -1.0}, "Case.duration = -1.0: input should be greater than 0"),
        ({"duratoin": 1.0}, "unknown key 'duratoin', did you mean 'duration'?"),
        (
            {"faults": {"main": {"contact": SPLIT}}},
            NO_FRICTION,
        ),
    ):
        with pytest.raises(CaseError) as caught:
            case.model_copy(update=changes)
        assert says(message, str(caught.value))
    longer = case.model_copy(update={"duration": 2 * case.duration})
    assert longer.hash == parse_case(plates({"duration": 2 * case.duration})).hash
    assert case.model_copy() == case
    # Which fields were given still shows: a slip rate that was not given fixes no stress.
    law = RateAndStateAgeing(a=0.01, b=0.02, D_c=1e-6, f_0=0.6, V_0=1e-6, theta_initial=1.0)
    assert law.model_copy(update={"b": 0.005}).given_slip_rate() is None


def test_nearest() -> None:
    assert nearest("frition", ["friction", "contact"]) == "did you mean 'friction'?"
    assert nearest("zzz", ["b", "a"]) == "known: a, b"
    assert nearest("zzz", []) == "there are none"


def test_find() -> None:
    assert find("ruptfx.laws.friction", "coulomb") is Coulomb
    assert "_rate_and_state" not in kinds("ruptfx.laws.friction")


def test_the_former_key_of_collisions_is_read_with_a_note() -> None:
    with pytest.warns(FormerName, match="'hand_over'.*'activate_at'"):
        assert Potential.model_validate({"hand_over": 0.5}).activate_at == 0.5


def test_former_keys_are_read_with_a_note() -> None:
    with pytest.warns(FormerName, match="'follow'.*'update_slip'"):
        assert Sliding.model_validate({"follow": 0.5}).update_slip == 0.5
    with pytest.raises(ValidationError, match="follow"):  # both names
        Sliding.model_validate({"follow": 0.5, "update_slip": 0.1})
    with warnings.catch_warnings(action="error"):
        assert Sliding(update_slip=0.1).update_slip == 0.1


@pytest.mark.parametrize(("former", "kind"), [("everywhere", "intrinsic"), ("on_strength", "extrinsic")])
def test_former_kinds_are_read_with_a_note(former: str, kind: str) -> None:
    with pytest.warns(FormerName, match=facts(f"'{former}'.*'{kind}'")):
        case = parse_case(block({"fracture.kind": former}))
    assert case.fracture.kind() == kind and f'kind = "{kind}"' in case.to_toml()
    with warnings.catch_warnings(action="error"):
        assert parse_case(block({"fracture.kind": kind})).hash == case.hash


def test_former_flags_of_steppers_are_read_with_a_note() -> None:
    from ruptfx.stepping.steppers import Stepper

    with pytest.warns(FormerName) as noted:

        class OfThePastVersion(Stepper):
            keeps_ties, sliding, elastic_contact_only = True, False, True

    assert OfThePastVersion.offers == (Stepper.offers | {"ties"}) - {"sliding", "rigid contact"}
    assert sorted(str(each.message).split("'")[1] for each in noted) == [
        "elastic_contact_only", "keeps_ties", "sliding",
    ]  # fmt: skip
    assert Stepper.offers >= {"sliding", "rigid contact"}


def test_a_class_offers_and_needs_what_it_writes() -> None:
    """The contract offers nothing by its own methods; a class and those below it what it writes or mixes in."""
    from ruptfx.bodies.boundaries import Boundary
    from ruptfx.laws.contact import ContactMethod

    class Springs:
        def stiffness(self) -> tuple[float, float]:
            return 1.0, 1.0

    class Mixed(Springs, ContactMethod):
        pass

    class Swept(Mixed):
        def sweeps_to(self) -> tuple[float, int]:
            return 1e-6, 3

    class Rings(Boundary):
        waves = True

    class Damps(Boundary):
        waves = False

    assert not ContactMethod.offers and Mixed.offers == {"stiffness"} and Swept.offers == {"stiffness", "sweeps"}
    assert not Boundary.needs and Rings.needs == {"inertia"} and not Damps.needs


def test_former_attributes_of_plug_ins_are_read_with_a_note() -> None:
    with pytest.warns(FormerName, match=facts("'left'.*'remaining_fraction'")):

        class Falling(CohesiveLaw):
            area = 0.5

            def left(self, damage: np.ndarray) -> np.ndarray:
                return 1 - damage

    law = Falling(f_t=2.0, c=4.0, G_Ic=1.0, G_IIc=1.0)
    assert law.remaining_cohesion(np.array([0.0, 0.25, 1.0])).tolist() == [4.0, 3.0, 0.0]


def test_commands_show_a_former_name_once(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def warned() -> str:
        with reported():
            for _ in range(2):
                warn_of_former("the key", "follow", "update_slip")
        return capsys.readouterr().err

    assert warned().count("update_slip") == 1
    monkeypatch.setenv(launch.RANKS, "2")  # the launcher has shown it
    assert warned() == ""


def test_parts_are_strict_and_frozen() -> None:
    law = Coulomb(mu_d=0.5)
    with pytest.raises(CaseError, match=r"mu_d = 0\.6"):
        law.mu_d = 0.6
    for wrong in ("0.5", None, True, float("nan")):
        with pytest.raises(CaseError, match="mu_d"):
            Coulomb(mu_d=wrong)
    assert Coulomb(mu_d=1).mu_d == 1  # a whole number is a number


def test_base_imports_nothing_heavy() -> None:
    """`import ruptfx`, laws and projection work where there is no DOLFINx and no MPI."""
    code = (
        "import sys, ruptfx, ruptfx.interfaces.faults.projection, ruptfx.input.profiles, ruptfx.case\n"
        "import ruptfx.results.record, ruptfx.many_runs.study.definition\n"
        "from ruptfx.input.schema import alternatives\n"
        "alternatives('ruptfx.laws.friction')\n"
        "print([name for name in ('dolfinx', 'mpi4py', 'petsc4py', 'ufl') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_help_of_the_package_is_short_and_names_everything() -> None:
    """Two screens of 30 lines, where the classes in full took a thousand; each public name is in its text."""
    code = "import pydoc, ruptfx; print(pydoc.plain(pydoc.render_doc(ruptfx)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert len(done.stdout.splitlines()) < 60
    assert [name for name in dir(ruptfx) if name not in done.stdout and name != "__version__"] == []


def test_the_public_names_are_listed() -> None:
    """In a fresh process, where none of them has been used."""
    code = "import ruptfx; print(*dir(ruptfx))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    names = [
        "Case",
        "Record",
        "RuptfxError",
        "__version__",
        "gradient",
        "infer",
        "plots",
        "read_case",
        "reconstruct",
        "simulate",
    ]
    assert done.stdout.split() == names


def test_without_dolfinx_the_error_names_commands_that_install_it() -> None:
    code = "import sys; sys.modules['basix'] = None; from ruptfx.platform import fem; fem.MPI"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    said = done.stderr.splitlines()[-1]
    assert "DOLFINx is not installed here" in said and f"{sys.executable} -m pip install 'ruptfx[fem]'" in said
    # What pip is told to install is in the project file, and `make env` is a target.
    root = Path(__file__).parents[2]
    assert "fem" in tomllib.loads((root / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert "make env" in said and "\nenv:" in (root / "Makefile").read_text()


def test_mpiexec_beside_python_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    monkeypatch.setenv("PATH", str(tmp_path / "elsewhere"))
    with pytest.raises(RuptfxError, match="mpiexec"):
        launch.find_mpiexec()
    (tmp_path / "elsewhere").mkdir()
    for name in ("elsewhere/mpirun", "mpiexec"):
        (tmp_path / name).write_text("#!/bin/sh\n")
        (tmp_path / name).chmod(0o755)
        assert launch.find_mpiexec() == str(tmp_path / name)


def test_check_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(launch.RANKS, raising=False)
    launch.check_size(3)
    monkeypatch.setenv(launch.RANKS, "2")
    launch.check_size(2)
    with pytest.raises(RuptfxError, match=facts("2 ranks were asked for, but mpi4py sees 1")):
        launch.check_size(1)
