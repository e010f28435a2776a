"""What many captures are measured with: a relay that leaves nothing behind, and layers that must not differ."""

from __future__ import annotations

import gc
import os
import socket
import threading
from pathlib import Path

import numpy as np
import pytest
import tifffile

from studies.many_captures import Relay, differing_layers


def talked_through(relay: Relay, server: socket.socket) -> tuple[socket.socket, socket.socket]:
    """Both ends of a connection through a relay, which something went through."""
    here = socket.create_connection(("127.0.0.1", relay.port))
    there, _ = server.accept()
    here.sendall(b"out")
    assert there.recv(16) == b"out"
    there.sendall(b"back")
    assert here.recv(16) == b"back"
    return here, there


def test_a_relay_counts_and_ends_whatever_is_still_open(recwarn: pytest.WarningsRecorder) -> None:
    threads = threading.active_count()
    with socket.create_server(("127.0.0.1", 0)) as server:
        with Relay(server.getsockname()[1]) as relay:
            ends = talked_through(relay, server)
            assert relay.count == 7
        # As where a study fails: the connection is still open.
        for end in ends:
            end.close()
    del relay
    # What was left behind would now be closed by whoever collects it, on a loop that is no more.
    gc.collect()
    assert not [str(warning.message) for warning in recwarn]
    assert threading.active_count() <= threads


def test_layers_that_differ_from_those_of_the_same_content_are_counted(tmp_path: Path) -> None:
    sources = []
    for i, content in enumerate((0, 0, 0, 1, 1)):
        sources.append(tmp_path / f"c{i}.npz")
        first = tmp_path / f"c{(0, 3)[content]}.npz"
        if first == sources[-1]:
            first.write_bytes(b"content")
        else:
            os.link(first, sources[-1])
        folder = tmp_path / "out" / f"c{i}"
        folder.mkdir(parents=True)
        for name in ("transmission", "reflection"):
            values = np.full((4, 4), content, np.float32)
            values[0, 0] += np.float32(1e-6) * (i == 2)
            tifffile.imwrite(folder / f"{name}.tiff", values)
    assert differing_layers(sources, tmp_path / "out") == 1
