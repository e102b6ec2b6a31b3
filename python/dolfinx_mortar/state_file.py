# Copyright (C) 2026 the dolfinx_mortar developers
# SPDX-License-Identifier: MIT
"""Files of records of doubles, written and read by any number of ranks.

A file is a header and blocks of records. The header begins with a line of magic words, the
version, the header's size and its checksum; a description in JSON follows, then blanks. A block
has one record for each cell of a mesh, cells in the order of the mesh's input. Its checksum is
the sum of those of the records, and so the same for any partition.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

_MAGIC = "dolfinx_mortar state"
_VERSION = 2
#: The header's size is a multiple of this, and so is no block out of line [bytes]
_PAGE = 4096
#: What files of version 1 begin with
_FIRST_VERSION = b'{"magic": "dolfinx_mortar state 1"'


class Block(NamedTuple):
    """This rank's records of a block.

    Attributes:
        cells: Number of each record in the block, shape (n,).
        total: Number of records on all ranks.
        values: Records, shape (n, width).
    """

    cells: npt.NDArray[np.integer]
    total: int
    values: npt.NDArray[np.float64]


def _checksum(comm: MPI.Intracomm, block: Block) -> int:
    """Checksum of a block, the same for any partition. Collective."""
    values = np.ascontiguousarray(block.values)
    # The number of a record takes part, so that records in wrong places are noticed
    mine = sum(zlib.crc32(v, int(c) & 0xFFFFFFFF) for c, v in zip(block.cells, values))
    return comm.allreduce(mine)


def _header(description: dict[str, Any]) -> bytes:
    """First line, description, blanks."""
    text = json.dumps(description).encode()
    start = f"{_MAGIC} {_VERSION} {0:08d} {0:08x}\n".encode()
    size = -(-(len(start) + len(text)) // _PAGE) * _PAGE
    body = text.ljust(size - len(start))
    return f"{_MAGIC} {_VERSION} {size:08d} {zlib.crc32(body):08x}\n".encode() + body


def _on_root(comm: MPI.Intracomm, action: Callable[[], Any]) -> tuple[Any, str]:
    """Do something on rank 0; result and message of what the system refused, on all ranks."""
    result, message = None, ""
    if comm.rank == 0:
        try:
            result = action()
        except OSError as error:
            message = error.strerror or str(error)
    return comm.bcast((result, message))


def _any_message(comm: MPI.Intracomm, message: str) -> str:
    return max(comm.allgather(message))


def _transfer(
    comm: MPI.Intracomm, path: Path, mode: int, start: int, blocks: Sequence[Block]
) -> str:
    """Write or read blocks, one after the other; a message where that fails on any rank."""
    message = ""
    try:
        file = MPI.File.Open(comm, str(path), mode)
    except MPI.Exception as error:
        message, file = str(error), None
    message = _any_message(comm, message)
    if message or file is None:
        if file is not None:
            file.Close()
        return message
    for b in blocks:
        width = b.values.shape[1]
        order = np.argsort(b.cells)
        record = np.ascontiguousarray(b.values[order])
        kind = MPI.DOUBLE.Create_contiguous(width).Commit()
        view = kind.Create_indexed_block(1, [int(c) for c in b.cells[order]]).Commit()
        try:
            file.Set_view(start, MPI.DOUBLE, view)
            (file.Write_all if mode == MPI.MODE_WRONLY else file.Read_all)(record)
        except MPI.Exception as error:  # perhaps on this rank alone: the others go on
            message = str(error)
        b.values[order] = record
        view.Free()
        kind.Free()
        start += b.total * width * 8
    try:
        if mode == MPI.MODE_WRONLY:
            file.Sync()
        file.Close()
    except MPI.Exception as error:
        message = str(error)
    return _any_message(comm, message)


def _reserve(path: Path, header: bytes, size: int) -> None:
    """Make a file with a header and with room for all that follows.

    Raises:
        OSError: As where there is no space left.
    """
    with open(path, "wb") as f:
        f.write(header)
        f.flush()
        f.truncate(size)
        if hasattr(os, "posix_fallocate"):
            # What MPI says of a full disk, if it says anything, differs
            os.posix_fallocate(f.fileno(), 0, size)


def write(
    comm: MPI.Intracomm, path: Path, description: dict[str, Any], blocks: Sequence[Block]
) -> None:
    """Write a file. Collective.

    A file that was there before stays until the new one is complete.

    Args:
        comm: Communicator.
        path: File.
        description: What JSON can hold; the same on all ranks.
        blocks: Records of the blocks.

    Raises:
        RuntimeError: The file cannot be written; on all ranks.
    """
    partial = path.with_name(path.name + ".partial")
    header = _header(
        {
            "description": description,
            "blocks": [[b.total, int(b.values.shape[1])] for b in blocks],
            "checksums": [_checksum(comm, b) for b in blocks],
        }
    )
    size = len(header) + sum(8 * b.total * b.values.shape[1] for b in blocks)
    complete = False
    try:
        _, message = _on_root(comm, lambda: _reserve(partial, header, size))
        if not message:
            message = _transfer(comm, partial, MPI.MODE_WRONLY, len(header), blocks)
        if not message:
            _, message = _on_root(comm, lambda: os.replace(partial, path))
        complete = not message
    finally:
        if not complete and comm.rank == 0:
            partial.unlink(missing_ok=True)
    if message:
        raise RuntimeError(f"The state cannot be written to {path}: {message}.")


def _parse(path: Path) -> tuple[dict[str, Any], int]:
    """Header, verified, and its size.

    Raises:
        OSError: The file cannot be read.
        ValueError: It is no state file, or it is damaged; the message says so.
    """
    with open(path, "rb") as f:
        line = f.read(len(f"{_MAGIC} {_VERSION} {0:08d} {0:08x}\n"))
        if line.startswith(_FIRST_VERSION[: len(line)]) and len(line) > len(_MAGIC):
            raise ValueError(
                f"{path} was written by an earlier version of dolfinx_mortar (state files of "
                f"version 1, here it is {_VERSION}). Continue with that version, or compute the "
                "state anew."
            )
        words = line.decode("ascii", "replace").split(" ")
        if not line.startswith(_MAGIC.encode()) or len(words) < 4:
            raise ValueError(f"{path} is not a state file of dolfinx_mortar.")
        version = words[2]
        if version != str(_VERSION) and version.isdecimal():
            raise ValueError(
                f"{path} is a state file of version {version}, but this dolfinx_mortar reads "
                f"version {_VERSION}."
            )
        damaged = ValueError(f"{path} is damaged: the checksum of its header is wrong.")
        if not words[3].isdecimal():
            raise damaged
        size = int(words[3])
        if not 0 < size <= os.path.getsize(path):
            raise ValueError(f"{path} is truncated, or its header is damaged.")
        body = f.read(size - len(line))
        if line != f"{_MAGIC} {_VERSION} {size:08d} {zlib.crc32(body):08x}\n".encode():
            raise damaged
    header = json.loads(body)
    total = size + sum(8 * n * width for n, width in header["blocks"])
    if os.path.getsize(path) != total:
        short = os.path.getsize(path) < total
        raise ValueError(
            f"{path} is {'truncated' if short else 'damaged'}: it has {os.path.getsize(path)} "
            f"bytes, but should have {total}."
        )
    return header, size


def read_description(comm: MPI.Intracomm, path: Path) -> dict[str, Any]:
    """Description of a file whose header is sound. Collective.

    Raises:
        RuntimeError: The file is missing, no state file, of another version, truncated or damaged;
            on all ranks.
    """

    def parse() -> Any:
        try:
            return _parse(path), ""
        except ValueError as error:
            return None, str(error)

    result, message = _on_root(comm, parse)
    if message:
        raise RuntimeError(f"The state cannot be read from {path}: {message}.")
    if result[1]:
        raise RuntimeError(result[1])
    header, size = result[0]
    return {**header, "size": size}


def read(
    comm: MPI.Intracomm, path: Path, header: dict[str, Any], cells: Sequence[npt.NDArray]
) -> list[npt.NDArray[np.float64]]:
    """Read this rank's records of all blocks, and verify those of all ranks. Collective.

    Args:
        comm: Communicator.
        path: File.
        header: From :func:`read_description`.
        cells: For each block the records that the rank is to have; all ranks together all records,
            each once.

    Returns:
        For each block the records, shape (n, width).

    Raises:
        RuntimeError: The file cannot be read, or it is damaged; on all ranks.
    """
    blocks = [
        Block(c, total, np.empty((len(c), width)))
        for c, (total, width) in zip(cells, header["blocks"], strict=True)
    ]
    message = _transfer(comm, path, MPI.MODE_RDONLY, header["size"], blocks)
    if message:
        raise RuntimeError(f"The state cannot be read from {path}: {message}.")
    for b, expected in zip(blocks, header["checksums"]):
        if _checksum(comm, b) != expected:
            raise RuntimeError(f"{path} is damaged: the checksum of its data is wrong.")
    return [b.values for b in blocks]
