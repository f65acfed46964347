"""Checkpoints: data to restart a run, on any number of ranks.

A checkpoint is a directory `checkpoints/step_NNNNNNNN` with the state and a copy of every history file of that
time: a process may die while HDF5 writes, so the live files cannot be trusted afterwards. It is written under a
temporary name, synced, renamed; the last two are kept. Node and point arrays are in an order that does not depend on
the partition; every rank writes and reads its block of the former.

A complete run has `checkpoints/final`, from which a longer run continues. It has no copies: the files of the run do not
change any more, and `files.json` has their checksums.
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import h5py
import numpy as np

from ruptfx import RuptfxError, Table, __version__
from ruptfx.platform import fem, parallel, run_files
from ruptfx.platform.files import checksum as _checksum
from ruptfx.platform.run_files import seal as _seal
from ruptfx.platform.stopwatch import phase
from ruptfx.results import directories
from ruptfx.run.recording.shared_file import SharedFile

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.case import Case
    from ruptfx.interfaces.mechanisms import Rows
    from ruptfx.run.model import Model

FOLDER = directories.CHECKPOINTS
KEPT = 2
LAYOUT = 4  # version of the manifest, increased with every change that older code cannot read
_ANEW = "run the case again with another --out"
READ_ONLY = ("state", "bulk")
"""Stems of the files of a checkpoint that are read; the others are copied to the run directory and grow there."""


class CheckpointError(RuptfxError):
    """A checkpoint that cannot be used, with the reason and the remedy."""


class Keeper(Protocol):
    """An object besides the state with data that change from step to step."""

    def table(self) -> Table | None:
        """Return all data that change, as JSON values, on rank 0 at least; collective."""

    def restore(self, table: Table) -> None:
        """Restore the data from such a table, which every rank receives."""


class Files(Protocol):
    """Writer of the histories of a run."""

    out: Path
    """The run directory."""

    def sync_bodies(self, state: State) -> None:
        """Bring what the steps have left undone in the bodies up to date; collective."""

    def collect(self) -> None:
        """Gather what instruments keep on their ranks; collective."""

    def meet(self, write: Callable[[], None]) -> None:
        """Write this, too, and wait for all ranks; raise on all of them if one fails; collective."""

    def reopen(self) -> list[Path]:
        """Write all data in memory; return the history files of this rank, which may then be copied."""


class Checkpoints:
    """Writes the checkpoints of a run when they are due.

    Parameters
    ----------
    keepers : dict of str to Keeper
        All objects with such data, by their names in a checkpoint.
    """

    def __init__(self, model: Model, recorder: Files, keepers: Mapping[str, Keeper]) -> None:
        self._model, self._recorder, self._keepers = model, recorder, keepers
        self._minutes, self._steps = model.case.output.checkpoint_minutes, model.case.output.checkpoint_steps
        self._last = time.monotonic()

    def scheduled(self, state: State) -> bool:
        """Return whether the case requests a checkpoint at this step."""
        return self._steps is not None and state.step % self._steps == 0

    def due(self, state: State) -> bool:
        """Return whether a checkpoint is scheduled or overdue by rank 0's clock, the same on all ranks; collective."""
        if self._steps is not None:
            return self.scheduled(state)
        return bool(self._model.comm.bcast(time.monotonic() - self._last > 60 * self._minutes, root=0))

    def write(self, state: State, final: bool = False) -> None:
        """Save now, at the end of the run without copies of its files; collective.

        Raises
        ------
        RuptfxError
            On all ranks, when the disk is full; the previous checkpoints are untouched.
        """
        model, recorder = self._model, self._recorder
        recorder.sync_bodies(state)
        nodal = {"displacement": state.displacement, "velocity": state.velocity, **state.fields}
        with phase("gathering"):
            blocks = {name: model.layout.collect(values) for name, values in nodal.items()}
            groups = {group: rows for each in model.mechanisms for group, rows in each.saved(state).items()}
            energy = model.comm.gather(state.energy, root=0)
            recorder.collect()
            memory = {name: keeper.table() for name, keeper in self._keepers.items()}
        first, checksums = model.comm.rank == 0, run_files.Sums()
        folder = recorder.out / FOLDER
        temporary, place = folder / ".unfinished", folder / (directories.FINAL if final else f"step_{state.step:08d}")
        recorder.meet(lambda: _make_anew(temporary) if first else None)
        recorder.meet(lambda: checksums.update(self._write_files(temporary, blocks, groups, not final)))
        of_ranks = model.comm.gather(checksums, root=0)
        if of_ranks is not None:
            files = {name: checksum for each in of_ranks for name, checksum in each.items()}
            manifest = self._manifest(state, energy, memory, dict(sorted(files.items())))
        recorder.meet(lambda: _complete(temporary, place, manifest) if first else None)
        self._last = time.monotonic()

    def _write_files(
        self, folder: Path, blocks: dict[str, np.ndarray], groups: Mapping[str, Rows], copies: bool
    ) -> run_files.Sums:
        """Write this rank's part of the state and copies of its history files; return checksums of the files."""
        with SharedFile(self._model.comm, folder / "state.h5") as file:
            for name, block in blocks.items():
                file.write(f"nodes/{name}", block, self._model.total_nodes)
            if file.whole is not None:
                for group, fields in groups.items():
                    file.whole.create_group(group).update(fields)
        written, histories = list(file.paths), self._recorder.reopen()
        for path in histories if copies else []:
            written.append(folder / path.name)
            shutil.copyfile(path, written[-1])
        for path in written:
            _sync(path)
        return {**{path.name: None for path in histories}, **{path.name: _checksum(path) for path in written}}

    def _manifest(
        self, state: State, energy: list[dict[str, float]] | None, memory: dict[str, Table | None],
        files: run_files.Sums,
    ) -> Table:  # fmt: skip
        return {
            "case_hash": self._model.case.hash, "ruptfx_version": __version__, "layout": LAYOUT,
            "step": state.step, "energy": energy,
            "time": state.time, "numbers": state.numbers, "fields": list(state.fields), "memory": memory,
            "points": {fault: list(fields) for fault, fields in state.points.items()},
            "files": {name: value for name, value in files.items() if value is not None},
            "histories": [name for name, value in files.items() if value is None],
        }  # fmt: skip


class Checkpoint:
    """The checkpoint from which a run continues.

    Attributes
    ----------
    path : Path
    manifest : dict
        Known to all ranks.
    """

    def __init__(self, path: Path, manifest: Table) -> None:
        self.path, self.manifest = path, manifest

    @classmethod
    def latest(cls, comm: fem.MPI.Comm, out: Path, case: Case) -> Checkpoint | None:
        """Return the newest checkpoint of a run directory, or the previous one if that is damaged; collective.

        None if the run was stopped before its first checkpoint.

        Raises
        ------
        CheckpointError
            No undamaged checkpoint, or one of another case or version.
        """

        root = parallel.on_root(comm, lambda: newest(all_of(out), case))
        return None if root is None else cls(*root)

    def restore_files(self, out: Path) -> None:
        """Restore the history files of interfaces and energies; rank 0 only.

        Every rank reads the files of the bodies, also if other ranks wrote them.
        """
        for name in self.manifest["files"]:
            if name.partition(".")[0] not in READ_ONLY:
                shutil.copyfile(self.path / name, out / name)

    def restore(self, model: Model, state: State) -> None:
        """Fill the state; collective.

        Raises
        ------
        CheckpointError
            On all ranks: it cannot be read.
        """
        error, blocks = None, dict[str, np.ndarray]()
        state.points = {
            fault.name: {name: np.empty(len(fault.interface.plus)) for name in self.manifest["points"][fault.name]}
            for fault in model.faults if fault.name in self.manifest["points"]
        }  # fmt: skip
        try:
            with h5py.File(self.path / "state.h5", locking=False) as file:
                own_rows = model.layout.rows.here
                for name, rows in file["nodes"].items():
                    if len(rows) != model.total_nodes:
                        raise CheckpointError(
                            f"{self.path}: '{name}' has {len(rows)} nodes and the mesh {model.total_nodes}; {_ANEW}"
                        )
                    blocks[name] = rows[own_rows]
                for each in model.mechanisms:
                    each.restore(state, lambda name: np.asarray(file[name][()]))
        except CheckpointError as caught:
            error = caught
        except (OSError, KeyError, ValueError) as caught:
            error = CheckpointError(f"{self.path}: rank {model.comm.rank} cannot read it ({caught}); all ranks have to")
        parallel.raise_on_all(model.comm, error)
        for name in ("displacement", "velocity"):
            getattr(state, name)[:] = model.layout.spread(blocks[name])
        state.fields = {name: model.layout.spread(blocks[name]) for name in self.manifest["fields"]}
        # What each rank accumulated; on another number of ranks rank 0 takes the sum.
        saved, rank = self.manifest["energy"], model.comm.rank
        for name in state.energy:
            if len(saved) == model.comm.size:
                state.energy[name] = saved[rank].get(name, 0.0)
            else:
                state.energy[name] = sum(part.get(name, 0.0) for part in saved) if rank == 0 else 0.0
        state.step, state.time = self.manifest["step"], self.manifest["time"]
        state.numbers = dict(self.manifest["numbers"])

    def recall(self, keepers: Mapping[str, Keeper]) -> None:
        """Restore the data of all objects besides the state; checkpoints of earlier versions lack some of them."""
        for name, keeper in keepers.items():
            if name in self.manifest["memory"]:
                keeper.restore(self.manifest["memory"][name])


def _make_anew(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)


def _complete(temporary: Path, final: Path, manifest: Table) -> None:
    """Add the checksum of a checkpoint, rename it to its final name, and remove all older ones but the last."""
    write_manifest(temporary, manifest)
    _sync(temporary / "manifest.json")
    shutil.rmtree(final, ignore_errors=True)
    temporary.replace(final)
    _sync(final.parent)
    for old in all_of(final.parent.parent)[:-KEPT]:
        shutil.rmtree(old)


def all_of(out: Path) -> list[Path]:
    """Return the checkpoints of a run directory, the newest last."""
    result = (out / FOLDER).glob("step_*")
    return sorted(path for path in result if path.is_dir() and path.name.removeprefix("step_").isdecimal())


def newest(paths: list[Path], case: Case) -> tuple[Path, Table] | None:
    """Return the last of these checkpoints that is undamaged, and its manifest; None if there are none.

    Raises
    ------
    CheckpointError
        None undamaged, or of another case or version.
    """
    refused = []
    for path in reversed(paths):
        try:
            return path, _verified(path, case)
        except CheckpointError as error:
            refused.append(str(error))
    if refused:
        raise CheckpointError("\n".join(refused))
    return None


def write_manifest(path: Path, manifest: Table) -> None:
    """Write the manifest of a checkpoint with its checksum."""
    (path / "manifest.json").write_text(json.dumps({**manifest, "seal": _seal(manifest)}, indent=2) + "\n")


def read_manifest(path: Path) -> Table:
    """Return the manifest of a checkpoint.

    Raises
    ------
    CheckpointError
        Missing or damaged.
    """
    try:
        manifest = json.loads((path / "manifest.json").read_text())
        seal = manifest.pop("seal")
    except (OSError, ValueError, KeyError, AttributeError):
        raise CheckpointError(f"{path}: manifest.json is missing or damaged; {_ANEW}") from None
    if seal != _seal(manifest):
        raise CheckpointError(f"{path}: manifest.json does not match its own checksum; {_ANEW}")
    # Anybody can compute the checksum: names are used as paths, also to write.
    for name in (*manifest["files"], *manifest.get("histories", [])):
        if Path(name).name != name:
            raise CheckpointError(
                f"{path}: manifest.json names the file {name!r}, and a run writes no files elsewhere than in its "
                "directory; do not use this checkpoint"
            )
    return manifest


def _verified(path: Path, case: Case) -> Table:
    """Return the manifest after every check."""
    manifest = read_manifest(path)
    if manifest.get("layout") != LAYOUT:
        raise CheckpointError(f"{path}: written by another revision of ruptfx; resume with that revision, or run again")
    if manifest["ruptfx_version"] != __version__:
        raise CheckpointError(
            f"{path}: written by ruptfx {manifest['ruptfx_version']}, this is {__version__}; resume with that version"
        )
    if manifest["case_hash"] not in (case.hash, case.hash_without_files):
        raise CheckpointError(
            f"{path}: belongs to case {manifest['case_hash']}, this is case {case.hash}; "
            "resume with the case.toml of the run directory, and with the revision of ruptfx that began it"
        )
    for name, checksum in manifest["files"].items():
        file = path / name
        if not file.is_file() or _checksum(file) != checksum:
            raise CheckpointError(f"{file}: missing or damaged (its checksum differs); {_ANEW}")
        if file.suffix == ".h5" and name.partition(".")[0] not in READ_ONLY:
            _require_own_data(file)
    return manifest


def _require_own_data(path: Path) -> None:
    """Refuse an HDF5 file that stores data in another file, to which a resumed run would write.

    Raises
    ------
    CheckpointError
    """

    def elsewhere(name: str, item: h5py.Group | h5py.Dataset) -> str | None:
        if isinstance(item, h5py.Dataset):
            return name if item.external or item.is_virtual else None
        links = (key for key in item if isinstance(item.get(key, getlink=True), h5py.ExternalLink))
        return next((f"{name}/{key}" for key in links), None)

    with h5py.File(path, locking=False) as file:
        result = elsewhere("", file) or file.visititems(elsewhere)
    if result is not None:
        raise CheckpointError(f"{path}: keeps '{result}' in another file, as no run does; do not use this checkpoint")


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
