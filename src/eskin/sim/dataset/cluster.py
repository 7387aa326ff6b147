"""This module writes sessions of a set on the machines of a Ray cluster."""

import socket
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import urlsplit

from eskin.compiled import digest_code
from eskin.errors import GenerationError
from eskin.files import atomic_path
from eskin.registry import find_package
from eskin.sim.dataset.clip_generator import ClipGenerator
from eskin.sim.dataset.generate import (
    PENDING_PER_WORKER,
    Rows,
    WriteSessions,
    write_file,
)
from eskin.sim.dataset.index import ClipRow
from eskin.sim.dataset.plan import SessionPlan
from eskin.sim.dataset.settings import GenerationSettings

AUTO = "auto"
"""Address that stands for the cluster of this machine."""
HEAD_SECONDS = 3.0
"""Longest time to wait for the head of a cluster [s]."""
ALWAYS = -1
"""Number of times that a share whose worker is lost is done again."""


@contextmanager
def open_cluster(address: str) -> Iterator[WriteSessions]:
    """Connect to a cluster, and yield the function that writes sessions on it.

    Each session is one task on one core. Its file comes back over the network, so the
    machines need no common disk; they need the same version of eskin. The share of a
    machine that is lost is done again by others. The address is the `HOST:PORT` of the
    cluster's head, or `auto`.

    Raises:
        ExtraError: Ray is not installed.
        GenerationError: there is no cluster at the address. Within the block: a machine
            has another version of eskin, or a clip cannot be made.
    """
    ray = find_package("ray", "Ray", "scale", "--ray")
    try:
        check_head(address)
        ray.init(address, log_to_driver=False, logging_level="ERROR")
    except (OSError, ValueError, RuntimeError) as error:
        raise GenerationError(
            f"no Ray cluster at '{address}' ({str(error).splitlines()[0]}); allowed is "
            "the HOST:PORT of its head, or auto on one of its machines; start one with "
            "ray start --head"
        ) from error
    try:
        yield partial(write_on_cluster, ray)
    finally:
        # Tasks of this connection end with it.
        ray.shutdown()


def check_head(address: str) -> None:
    """Raise unless something listens at an address; Ray would try for minutes.

    Raises:
        OSError: nothing does.
        ValueError: it is neither `HOST:PORT` nor `auto`.
    """
    if address == AUTO:
        return
    parts = urlsplit(f"//{address}")
    if parts.hostname is None or parts.port is None:
        raise ValueError("it is no HOST:PORT")
    with socket.create_connection((parts.hostname, parts.port), HEAD_SECONDS):
        pass


def write_on_cluster(
    ray: Any,  # noqa: ANN401
    folder: Path,
    settings: GenerationSettings,
    sessions: Sequence[SessionPlan],
    factory: Callable[[str], ClipGenerator],
) -> Rows:
    """Write the files of sessions on the cluster that Ray is connected to.

    The arguments are as for `write_sessions`; `factory` must be importable on all
    machines.
    """
    task = ray.remote(num_cpus=1, max_retries=ALWAYS)(make_file)
    version = digest_code(__name__)
    left = deque(sessions)
    waiting: deque[tuple[SessionPlan, Any]] = deque()
    while left or waiting:
        cores = int(ray.cluster_resources().get("CPU", 0))
        while left and len(waiting) < PENDING_PER_WORKER * max(cores, 1):
            plan = left.popleft()
            waiting.append((plan, task.remote(settings, plan, factory, version)))
        plan, share = waiting.popleft()
        data, rows = fetch(ray, share)
        with atomic_path(folder / plan.file, durable=True) as part:
            part.write_bytes(data)
        yield rows


def fetch(ray: Any, share: Any) -> tuple[bytes, tuple[ClipRow, ...]]:  # noqa: ANN401
    """Wait for a share; return the bytes of its file and its rows.

    Raises:
        GenerationError: it cannot be made.
    """
    try:
        return ray.get(share)
    except ray.exceptions.RayTaskError as error:
        cause = error.cause
        if isinstance(cause, GenerationError):
            raise cause from error
        raise GenerationError(
            f"a worker of the cluster failed ({type(cause).__name__}: {cause}); "
            "allowed is a cluster with the same eskin everywhere; run the same command "
            "again to go on"
        ) from error
    except ray.exceptions.RayError as error:
        raise GenerationError(
            f"the cluster is lost ({type(error).__name__}); start it, and run the same "
            "command again to go on"
        ) from error


def make_file(
    settings: GenerationSettings,
    plan: SessionPlan,
    factory: Callable[[str], ClipGenerator],
    version: str,
) -> tuple[bytes, tuple[ClipRow, ...]]:
    """Make the file of a session on a worker; return its bytes and its rows.

    `version` is the digest of the code of who asks.

    Raises:
        GenerationError: this machine has other code, or a clip cannot be made.
    """
    if digest_code(__name__) != version:
        raise GenerationError(
            "a machine of the cluster has another version of eskin; allowed is the "
            "same everywhere; install it there"
        )
    with TemporaryDirectory() as folder:
        path = Path(folder, plan.file)
        path.parent.mkdir(parents=True, exist_ok=True)
        rows = write_file(Path(folder), settings, plan, factory)
        return path.read_bytes(), rows
