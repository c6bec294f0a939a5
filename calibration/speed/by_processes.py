"""Two processes against one, each on a core of its own: large batches, and a stream that has no end.

    softjax speed --processes

Each process holds its half of an array that JAX spreads over both; times are the best of a few calls
after the first, so that starting and compiling are left out. Needs a system that pins processes to cores (Linux).
"""

import json
import os
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any

import jax
import numpy as np

import softjax as sj
from calibration.errors import InputError
from calibration.speed.measure import status_mib
from calibration.speed.scene import stainless

IMPACTS = 20_000_000
STREAMED, BLOCK = 100_000_000, 8_000_000
REPEATS = 5


def report(impacts: int = IMPACTS, streamed: int = STREAMED) -> str:
    """What one process and two of them measured, as lines.

    Raises:
        InputError: where the system offers fewer than two cores, or does not pin, and where a
            process ends without an answer.
    """
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    if len(cores) < 2:
        accepted = "two cores that processes can be pinned to are needed"
        raise InputError(None, None, f"{len(cores)} cores can be used", accepted)
    load = os.getloadavg()[0]
    (one,) = _run(cores[:1], impacts, 0)
    two = _run(cores[:2], impacts, streamed)
    seconds = max(each["seconds"] for each in two)
    work = max(each["work"] for each in two)
    lines = [
        f"energy balance, {impacts:,} impacts; load {load:.1f} before",
        f"  one process, one thread   {one['seconds']:.3f} s, {one['mib']:.0f} MiB",
        f"  two processes, one each   {seconds:.3f} s, {two[0]['mib']:.0f} MiB each: "
        f"{one['seconds'] / seconds:.2f} times as fast",
        f"  of processor time   {one['work']:.3f} s, and {work:.3f} s each: "
        f"{one['work'] / work:.2f} times less, whatever else the machine is at",
        f"  {streamed:,} impacts streamed by two   "
        f"{max(each['stream'] for each in two):.1f} s, "
        f"{max(each['stream_mib'] for each in two):.0f} MiB each at most",
    ]
    return "\n".join(lines)


def _run(cores: list[int], impacts: int, streamed: int) -> list[dict[str, float]]:
    """A process on each core; what each measured."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    told = [port, str(len(cores)), str(impacts), str(streamed)]
    command = [sys.executable, "-m", __name__]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    started = [
        subprocess.Popen([*command, str(k), str(core), *told], **pipes)
        for k, core in enumerate(cores)
    ]
    return [json.loads(answer.splitlines()[-1]) for answer in _answers(started)]


def _answers(started: list[subprocess.Popen]) -> list[str]:
    """What each process prints; the others of one that fails would wait for it."""
    with ThreadPoolExecutor(len(started)) as pool:
        ends = {pool.submit(one.communicate): one for one in started}
        for end in as_completed(ends):
            code = ends[end].returncode
            if code == 0:
                continue
            for one in started:
                one.kill()
            last = "".join(end.result()[1].splitlines()[-1:]) or "it said nothing"
            accepted = "processes that can meet, and memory for all impacts, are needed"
            raise InputError(None, None, f"a process ended with exit code {code}: {last}", accepted)
        return [end.result()[0] for end in ends]


def _measured(index: int, count: int, impacts: int, streamed: int) -> dict[str, float]:
    velocity, law = _velocities(index, count, impacts), stainless().law
    call = lambda v: sj.restitution(law, v, overlaps=False).coefficient  # noqa: E731
    jax.block_until_ready(call(velocity))
    seconds, work = [], []
    for _ in range(REPEATS):
        _meet(count)
        start, busy = time.perf_counter(), time.process_time()
        jax.block_until_ready(call(velocity))
        work.append(time.process_time() - busy)
        _meet(count)
        seconds.append(time.perf_counter() - start)
    found = {"seconds": min(seconds), "work": min(work), "mib": status_mib("VmHWM")}
    del velocity
    return found | _streamed(call, index, count, streamed)


def _streamed(call: Any, index: int, count: int, impacts: int) -> dict[str, float]:
    """Block after block, of which nothing is kept but a sum."""
    start, total = time.perf_counter(), 0.0
    for _ in range(0, impacts, BLOCK):
        (here,) = call(_velocities(index, count, BLOCK)).addressable_shards
        total += float(np.sum(here.data))
    return {"stream": time.perf_counter() - start, "stream_mib": status_mib("VmHWM"), "sum": total}


def _velocities(index: int, count: int, impacts: int) -> jax.Array | np.ndarray:
    """This process's part of all velocities."""
    here = np.resize(stainless().velocity, impacts // count)
    if count == 1:
        return here
    from jax.sharding import Mesh, NamedSharding, PartitionSpec

    each = NamedSharding(Mesh(np.array(jax.devices()), ("impacts",)), PartitionSpec("impacts"))
    return jax.make_array_from_process_local_data(each, here)


def _meet(count: int) -> None:
    if count > 1:
        from jax.experimental.multihost_utils import sync_global_devices

        sync_global_devices("speed")


def _main(arguments: list[str]) -> None:
    index, core, port, count, impacts, streamed = map(int, arguments)
    os.sched_setaffinity(0, {core})  # before JAX counts the cores
    if count > 1:
        jax.config.update("jax_cpu_collectives_implementation", "gloo")
        jax.distributed.initialize(f"127.0.0.1:{port}", count, index)
    sj.enable_x64()
    print(json.dumps(_measured(index, count, impacts, streamed)))


if __name__ == "__main__":
    _main(sys.argv[1:])
