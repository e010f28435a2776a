"""Decoding in a process of its own, with limits of time and memory, where a library has none.

Only arrays come back, as numpy writes them, without pickles. The process is no sandbox: it keeps a damaged or hostile
file from taking the machine's memory or time, or this process with it.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.errors import InputError, one_line

Arrays = dict[str, NDArray[Any]]

SECONDS = 60
"""Time that decoding one file may take; set by hand, a hundred times what 50 megapixels take."""
_BESIDE = 2**30
"""Bytes that it may take beside a few times its pixels; set by hand."""
_COPIES = 4
"""How many times as much memory as the decoded values it may take: copies of other types and orders. Set by hand."""
_START = "import sys; sys.path[:] = sys.argv[1].split('\\n'); from polaropt.capture.files.child import serve; serve()"


def decoded_in_child(
    function: str, data: bytes, arguments: Mapping[str, Any], n_bytes: int, seconds: float = SECONDS
) -> Arrays:
    """What a function of bytes makes of them, in a process of its own.

    Parameters
    ----------
    function : str
        ``module:name`` of a function that takes bytes and keywords, and returns arrays by name.
    data : bytes
    arguments : mapping
        The keywords, such as JSON can hold.
    n_bytes : int
        That the arrays are expected to have.
    seconds : float
        That it may take.

    Raises
    ------
    InputError
        It took too long, or was ended by the system.
    DecoderError
        The function raised something.
    """
    task = {
        "function": function,
        "arguments": dict(arguments),
        "memory": _BESIDE + _COPIES * n_bytes,
        "seconds": seconds,
    }
    request = json.dumps(task).encode() + b"\n" + data
    with subprocess.Popen(
        [sys.executable, "-c", _START, "\n".join(sys.path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    ) as process:
        try:
            answer, _ = process.communicate(request, timeout=seconds)
        except subprocess.TimeoutExpired:
            raise InputError(f"takes more than {seconds:g} s to decode; it may be damaged, copy it again") from None
        finally:
            process.kill()
    if process.returncode != 0 or not answer:
        raise InputError(
            "cannot be decoded within the memory that its size is worth, or at all; it may be damaged, copy it again"
        )
    return _arrays(answer)


class DecoderError(Exception):
    """What a decoder raised in its process."""


def _arrays(answer: bytes) -> Arrays:
    file = io.BytesIO(answer)
    told = json.loads(file.readline())
    if "refused" in told:
        raise InputError(told["refused"])
    if "error" in told:
        raise DecoderError(told["error"])
    return {name: np.lib.format.read_array(file, allow_pickle=False) for name in told["arrays"]}


def serve() -> None:
    """What the process does: a request on standard input, arrays on standard output."""
    # What libraries print must not get between the arrays.
    answer = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    task = json.loads(sys.stdin.buffer.readline())
    data = sys.stdin.buffer.read()
    module, name = task["function"].split(":")
    function: Callable[..., Arrays] = getattr(import_module(module), name)
    _limit(task["memory"], task["seconds"])
    try:
        arrays = function(data, **task["arguments"])
        told: dict[str, Any] = {"arrays": list(arrays)}
    except InputError as error:
        arrays, told = {}, {"refused": str(error)}
    except Exception as error:  # decoders raise whatever they like on damaged data
        arrays, told = {}, {"error": one_line(error)}
    answer.write(json.dumps(told).encode() + b"\n")
    for array in map(np.ascontiguousarray, arrays.values()):
        # numpy itself writes into a pipe only what it has copied before.
        np.lib.format.write_array_header_1_0(answer, np.lib.format.header_data_from_array_1_0(array))
        answer.write(array.view(np.uint8).data if array.size else b"")
    answer.close()


def _limit(memory: int, seconds: float) -> None:
    """Let the system refuse more memory, and end the process after its time even if nobody waits any more."""
    try:
        import resource
    except ImportError:  # not on Windows
        return
    taken = 0
    if os.path.exists("/proc/self/statm"):
        with open("/proc/self/statm", encoding="ascii") as file:
            taken = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + memory,) * 2)
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1,) * 2)
