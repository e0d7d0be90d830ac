# SPDX-License-Identifier: Apache-2.0
"""Engines of a batch: worker processes of this host, one core each, or the workers of a Ray cluster."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor, as_completed
from multiprocessing import get_context
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

from tof_core.cores import ONE_THREAD
from tof_core.errors import UsageError
from toftwin.label_call import FAILED, Outcome, label_one

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from multiprocessing.connection import Connection

    from toftwin.label_call import LabelCall


def run_local(calls: Sequence[LabelCall], workers: int) -> Iterator[Outcome]:
    """Label in processes of this host, each on its own core; if a process dies, only its bag fails."""
    cores = sorted(os.sched_getaffinity(0))
    free: SimpleQueue[_Worker] = SimpleQueue()
    crew = [_Worker(cores[i % len(cores)]) for i in range(min(workers or len(cores), max(len(calls), 1)))]
    for worker in crew:
        free.put(worker)

    def on_a_free_one(call: LabelCall) -> Outcome:
        worker = free.get()
        try:
            return worker.label(call)
        finally:
            free.put(worker)

    pool = ThreadPoolExecutor(len(crew), "bags")
    try:
        yield from (done.result() for done in as_completed([pool.submit(on_a_free_one, call) for call in calls]))
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for worker in crew:
            worker.dismiss()
        for worker in crew:
            worker.stop()


class _Worker:
    """A process that labels one bag after another; it is started on demand, and restarted if it has died."""

    def __init__(self, core: int) -> None:
        self._core = core
        self._process: Any = None
        self._line: Any = None

    def label(self, call: LabelCall) -> Outcome:
        """Label a bag in the process, and wait for the outcome."""
        if self._process is None or not self._process.is_alive():
            self._start()
        try:
            self._line.send(call)
            outcome: Outcome = self._line.recv()
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode
            return Outcome(call.bag, str(call.out), FAILED, f"its worker ended with {code}; see dmesg where memory ran out (-9)")
        return outcome

    def dismiss(self) -> None:
        """Send no more bags: a waiting process ends by itself."""
        if self._line is not None:
            self._line.close()

    def stop(self) -> None:
        """End the process; one that is labelling a bag is terminated."""
        if self._process is not None:
            self._process.join(2.0)
            self._process.terminate()
            self._process.join()

    def _start(self) -> None:
        # Spawned, since the threads that Embree and Numba have started here do not survive a fork.
        context = get_context("spawn")
        self._line, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self._core), daemon=True)
        self._process.start()
        theirs.close()


def _serve(line: Connection[Any, Any], core: int) -> None:
    """Main loop of the process: label bags until the connection is closed."""
    os.environ.update(ONE_THREAD)
    os.sched_setaffinity(0, {core})
    try:
        while True:
            line.send(label_one(line.recv()))
    except (EOFError, KeyboardInterrupt):
        return


def run_ray(calls: Sequence[LabelCall], workers: int) -> Iterator[Outcome]:
    """Label on the Ray cluster of RAY_ADDRESS or `ray start`; without one, on a temporary cluster of this host.

    Bags, scene and `--out` must be accessible to every worker under the same path.
    """
    try:
        import ray
    except ImportError:
        from toftwin.extras import install_line

        raise UsageError("Ray is not installed", where="--engine ray", todo=install_line("batch")) from None
    _join(ray, workers)
    try:
        task = ray.remote(num_cpus=1, max_retries=0, runtime_env={"env_vars": ONE_THREAD})(label_one)
        waiting = {task.remote(call): call for call in calls}
        while waiting:
            (ready,), _ = ray.wait(list(waiting), num_returns=1)
            call = waiting.pop(ready)
            try:
                yield ray.get(ready)
            except ray.exceptions.RayError as error:
                yield Outcome(call.bag, str(call.out), FAILED, f"its worker was lost ({type(error).__name__})")
    finally:
        ray.shutdown()


def _join(ray: Any, workers: int) -> None:
    """Connect to an existing cluster; otherwise start one that listens on this host only."""
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
    try:
        ray.init(address="auto", **quiet)
    except ConnectionError:
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        own = {"include_dashboard": False, "_node_ip_address": "127.0.0.1", "object_store_memory": 100_000_000}
        ray.init(address="local", num_cpus=workers or len(os.sched_getaffinity(0)), **own, **quiet)


ENGINES: dict[str, Callable[[Sequence[LabelCall], int], Iterator[Outcome]]] = {"local": run_local, "ray": run_ray}
