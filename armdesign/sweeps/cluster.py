"""Cases on a cluster, by dask.distributed: the only door to it.

The study goes to every worker once, also to those that come later. The scheduler gives the cases
of a dead worker to others.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import Any

from armdesign.errors import ArmDesignError
from armdesign.sweeps.cases import Case
from armdesign.sweeps.worker import (
    Outcome,
    Study,
    answer,
    died,
    forget,
    is_prepared,
    prepare,
    refuse_unless_sent,
)

PATIENCE = 10.0  # [s] for which a scheduler may be silent at the start
PREFIX = "armdesign-"
NOT_TAKEN = "its worker could not take the study, as its log says: is it of another version?"
PAUSE, PAUSES = 0.2, 50  # [s] of a worker that has no study, before it passes a case on; how often


def on_cluster(
    study: Study, cases: Sequence[Case], address: str, died_at: Callable[[Case], None]
) -> Iterator[tuple[Case, Outcome]]:
    """Cases with their outcomes, as they come.

    Args:
        study: what the cases share.
        cases: the cases.
        address: of the scheduler, as ``tcp://host:8786``.
        died_at: told each case that the scheduler gives to another because its worker died.

    Raises:
        ArmDesignError: dask.distributed is missing, a task or its options cannot be sent, or the
            scheduler cannot be reached or is gone.
    """
    try:
        from distributed.protocol.pickle import dumps
    except ImportError:
        remedy = 'pip install "armdesign[cluster]"'
        raise ArmDesignError("--scheduler", "needs dask.distributed", remedy) from None
    refuse_unless_sent((study, cases), dumps)
    with _without_traces():
        yield from _answers(study, cases, address, died_at)


def _answers(
    study: Study, cases: Sequence[Case], address: str, died_at: Callable[[Case], None]
) -> Iterator[tuple[Case, Outcome]]:
    from distributed import as_completed

    client, plugin = _client(address), f"{PREFIX}{study.name}"
    lost = deque[str]()
    try:
        client.register_plugin(_plugin(study), name=plugin)
        client.subscribe_topic("all", lambda event: lost.extend(_lost(event)))
        named: dict[str, Case] = {}

        def submitted(case: Case) -> Any:
            name = f"{plugin}-{len(named)}-{case.key}"
            named[name] = case
            return client.submit(_answered, study.name, case, key=name, pure=False)

        futures = as_completed([submitted(case) for case in cases], loop=client.loop)
        for future in futures:
            while lost:
                if (name := lost.popleft()) in named:
                    died_at(named[name])
            case, outcome = named[str(future.key)], _outcome(future, address)
            future.release()
            if outcome.error == NOT_TAKEN and _is_taken(client, study, address):
                futures.add(submitted(case))  # others were busy
            else:
                yield case, outcome
        client.unregister_worker_plugin(plugin)
    finally:
        client.close(timeout=PATIENCE)  # which drops what is still to do


@contextmanager
def _without_traces() -> Iterator[None]:
    """Without the traces that dask's client logs when a scheduler goes: an error says so."""
    logger = logging.getLogger("distributed.client")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


def _client(address: str) -> Any:
    """A client of the scheduler at an address.

    Dask waits for ever for the greeting of a server of another kind, and complains at the end of
    the program of a client that could not begin; so a greeting is waited for first.
    """
    from distributed import Client
    from distributed.utils import LoopRunner

    try:
        LoopRunner(asynchronous=False).run_sync(_greeted, address)
        return Client(address, timeout=PATIENCE, set_as_default=False)
    except Exception as error:  # of any kind, by what a server of another kind says
        fault = f"{address} cannot be reached or is no scheduler of dask ({type(error).__name__})"
        remedy = "start one with: dask scheduler, and workers with: dask worker ADDRESS"
        raise ArmDesignError("--scheduler", fault, remedy) from None


async def _greeted(address: str) -> None:
    """Raise unless there is a server that greets as dask's do."""
    from distributed.core import connect

    async with asyncio.timeout(PATIENCE):
        comm = await connect(address, timeout=PATIENCE)
        comm.abort()


def _plugin(study: Study) -> Any:
    """Task of every worker that comes: it takes the study."""
    from distributed import WorkerPlugin

    class Prepared(WorkerPlugin):  # type: ignore[misc]
        def setup(self, worker: Any) -> None:
            prepare(study)

        def teardown(self, worker: Any) -> None:
            forget(study)

    return Prepared()


def _is_taken(client: Any, study: Study, address: str) -> bool:
    """Whether any worker has the study."""
    try:
        return any(client.run(is_prepared, study.name, on_error="ignore").values())
    except (OSError, RuntimeError, AttributeError):  # the last two once a client has given up
        raise _gone(address) from None


_passed_on: Counter[tuple[str, str]] = Counter()  # studies and cases that this worker left


def _answered(name: str, case: Case) -> Outcome:
    """The outcome of a case; a worker that could not take the study leaves it to others.

    It says why in its own log. Where the case comes back again and again, others are busy, or
    there are none.
    """
    from distributed import Reschedule

    if is_prepared(name):
        return answer(name, case)
    _passed_on[name, case.key] += 1
    if _passed_on[name, case.key] > PAUSES:
        del _passed_on[name, case.key]
        return Outcome(answer={}, seconds=0.0, error=NOT_TAKEN, final=False)
    time.sleep(PAUSE)
    raise Reschedule


def _lost(event: tuple[float, Any]) -> Iterable[str]:
    """Keys of the cases under way on a worker that an event of the scheduler says has died."""
    message = event[1]
    if not isinstance(message, dict) or message.get("action") != "remove-worker":
        return ()
    return map(str, () if message.get("expected") else message.get("processing-tasks") or ())


def _outcome(future: Any, address: str) -> Outcome:
    from distributed import KilledWorker

    try:
        outcome: Outcome = future.result()
    except KilledWorker as error:
        return died(1 + int(error.allowed_failures))
    except CancelledError:
        raise _gone(address) from None
    return outcome


def _gone(address: str) -> ArmDesignError:
    remedy = "start it and run the sweep again, which goes on with its journal, if it has one"
    return ArmDesignError("--scheduler", f"{address} is gone", remedy)
