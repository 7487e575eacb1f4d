"""Cases on a cluster, by dask.distributed: the only door to it.

The study goes to every worker once, also to those that come later. The scheduler gives the cases
of a dead worker to others; the one that kills its workers is known once it is alone. The scheduler
needs no armdesign itself, nor do workers that take no case.
"""

from __future__ import annotations

import asyncio
import logging
import pickle
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, cast

from armdesign.errors import ArmDesignError
from armdesign.sweeps.cases import Case
from armdesign.sweeps.sending import Sent, sent
from armdesign.sweeps.worker import Outcome, Study, died, is_prepared
from armdesign.transaction import undisturbed

PATIENCE = 10.0  # [s] for which a scheduler, or its workers, may be silent at the start
LAST = 5.0  # [s] for which they may be silent at the end, or where one worker is asked
LOOK = 0.02  # [s] between two looks at what has come
PREFIX = "armdesign-"
NOT_TAKEN = "its worker could not take the study, as its log says: is it of another version?"
PAUSE, PAUSES = 0.2, 50  # [s] of a worker that has no study, before it passes a case on; how often


def on_cluster(
    study: Study,
    cases: Sequence[Case],
    address: str,
    died_at: Callable[[Case], None],
    say: Callable[[str], None],
) -> Iterator[tuple[Case, Outcome]]:
    """Cases with their outcomes, as they come.

    Args:
        study: what the cases share.
        cases: the cases.
        address: of the scheduler, as ``tcp://host:8786``.
        died_at: told each case that the scheduler gives to another because its worker died.
        say: told when there is no worker, and when one has come.

    Raises:
        ArmDesignError: dask.distributed is missing, a task or its options cannot be sent, a worker
            cannot take them, or the scheduler cannot be reached or is gone.
    """
    parcel = sent(study, cases, _dumps())
    with _without_traces():
        yield from _answers(parcel, cases, address, _Watch(address, died_at, say))


def refuse_unreachable(address: str) -> None:
    """Raise unless there is a scheduler at an address, before anything is changed for it.

    Raises:
        ArmDesignError: as of ``on_cluster``.
    """
    _dumps()
    with _without_traces():
        _client(address).close(timeout=PATIENCE)


def _dumps() -> Callable[[Any], Any]:
    """How dask writes down what travels."""
    try:
        from distributed.protocol.pickle import dumps
    except ImportError:
        remedy = 'pip install "armdesign[cluster]"'
        raise ArmDesignError("--scheduler", "needs dask.distributed", remedy) from None
    return cast(Callable[[Any], Any], dumps)


def _answers(
    parcel: Sent, cases: Sequence[Case], address: str, watch: _Watch
) -> Iterator[tuple[Case, Outcome]]:
    client, plugin = _client(address), f"{PREFIX}{parcel.name}"
    try:
        _register(client, parcel, plugin, address)
        watch.begin(client)
        yield from _Given(client, parcel.name, watch).outcomes(cases)
    finally:
        with undisturbed():
            _unregister(client, plugin)
            client.close(timeout=PATIENCE)  # which drops what is still to do


@dataclass
class _Given:
    """Cases that a scheduler was given.

    It gives a case up after some deaths of workers that had it, though others that they had may
    have killed them. Such a suspect is tried again alone, as on processes: it is at fault if it is
    given up then, or if a worker died that had nothing else.

    Attributes:
        client: of the scheduler.
        name: of the study.
        watch: what the scheduler tells.
        passed: how often workers without the study passed a case on, by key.
        deaths: of a case's workers, by key, as the scheduler counts them.
        suspects: cases that are still to be tried alone, by key.
    """

    client: Any
    name: str
    watch: _Watch
    passed: Counter[str] = field(default_factory=Counter)
    deaths: Counter[str] = field(default_factory=Counter)
    suspects: dict[str, Case] = field(default_factory=dict)

    def outcomes(self, cases: Sequence[Case]) -> Iterator[tuple[Case, Outcome]]:
        """Cases with their outcomes, as they come; each suspect alone, once no other is left."""
        yield from self._together(cases)
        while self.suspects:
            yield from self._together([self.suspects.pop(next(iter(self.suspects)))])

    def _together(self, cases: Sequence[Case]) -> Iterator[tuple[Case, Outcome]]:
        from distributed import as_completed

        futures = as_completed([self._submitted(case) for case in cases], loop=self.client.loop)
        while not futures.is_empty():
            while not futures.has_ready():
                self.watch.look()
                time.sleep(LOOK)
            self.watch.look()
            future = next(futures)
            case = self.watch.named[str(future.key)]
            try:
                outcome = self._outcome(case, future)
            except TimeoutError:  # its worker died before it gave the answer away, or hangs
                futures.add(future)
                continue
            future.release()
            if outcome is not None:
                yield case, outcome
            elif case.key not in self.suspects:
                futures.add(self._submitted(case))

    def _submitted(self, case: Case) -> Any:
        name = f"{PREFIX}{self.name}-{len(self.watch.named)}-{case.key}"
        self.watch.named[name] = case
        return self.client.submit(_asked(self.name), pickle.dumps(case), key=name, pure=False)

    def _outcome(self, case: Case, future: Any) -> Outcome | None:
        """The outcome of a case; None where it is to be tried again.

        Raises:
            ArmDesignError: the scheduler is gone.
            TimeoutError: the worker that has it does not answer.
        """
        from distributed import KilledWorker

        try:
            outcome: Outcome | None = future.result(timeout=LAST)
        except KilledWorker as error:
            return self._given_up(case, 1 + int(error.allowed_failures))
        except CancelledError:
            raise _gone(self.watch.address) from None
        if outcome is None:
            self.passed[case.key] += 1
            if self.passed[case.key] % PAUSES == 0 and not self._is_taken():  # none is just busy
                return Outcome(answer={}, seconds=0.0, error=NOT_TAKEN, final=False)
        return outcome

    def _is_taken(self) -> bool:
        return _is_taken(self.client, self.name, self.watch.address)

    def _given_up(self, case: Case, deaths: int) -> Outcome | None:
        """That a case kills its workers; None where another may have, and it is now a suspect."""
        suspected = case.key in self.deaths
        self.deaths[case.key] += deaths
        if suspected or case.key in self.watch.died_alone:
            return died(self.deaths[case.key])
        self.suspects[case.key] = case
        return None


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


def _plugin(parcel: Sent) -> Any:
    """Task of every worker that comes: it takes the study.

    It travels as it is and imports what it needs only then, so that a worker of another kind says
    that it cannot, and lives on.
    """
    from distributed import WorkerPlugin

    name, parts = parcel.name, list[Any](parcel)

    class Prepared(WorkerPlugin):  # type: ignore[misc]
        def setup(self, worker: Any) -> None:
            try:
                from armdesign.sweeps.sending import Sent, received
                from armdesign.sweeps.worker import prepare

                prepare(received(Sent(*parts)))
            except Exception as error:
                fault = getattr(error, "fault", f"cannot load armdesign ({error})")
                remedy = getattr(error, "remedy", "install it there, too")
                raise RuntimeError(fault, remedy) from None

        def teardown(self, worker: Any) -> None:
            from armdesign.sweeps.worker import forget

            forget(name)

    return Prepared()


def _register(client: Any, parcel: Sent, plugin: str, address: str) -> None:
    """Have the study taken by every worker.

    Raises:
        ArmDesignError: one cannot take it; or some are silent or dead, and no other has taken it.
    """
    from distributed.core import clean_exception
    from distributed.protocol.pickle import dumps

    how = {"plugin": dumps(_plugin(parcel)), "name": plugin, "idempotent": False}
    try:
        register = client.scheduler.register_worker_plugin
        responses = client.sync(register, callback_timeout=PATIENCE, **how)
    except OSError:  # also where the scheduler lost a worker meanwhile
        if not _is_taken(client, parcel.name, address):
            fault = f"no worker of {address} answers"
            raise ArmDesignError(
                "--scheduler", fault, "end those that hang, start others"
            ) from None
        return
    for worker, response in responses.items():
        if response["status"] == "error":
            fault, remedy = clean_exception(response["exception"])[1].args
            raise ArmDesignError(f"worker {worker}", fault, remedy)


def _unregister(client: Any, plugin: str) -> None:
    """Have the study forgotten, as far as scheduler and workers answer."""
    with suppress(Exception, asyncio.CancelledError):
        unregister = client.scheduler.unregister_worker_plugin
        client.sync(unregister, callback_timeout=LAST, name=plugin)


def _is_taken(client: Any, name: str, address: str) -> bool:
    """Whether any worker that answers has the study of a name."""
    try:
        return any(_has(client, worker, name) for worker in client.nthreads())
    except (OSError, RuntimeError, AttributeError):  # the last two once a client has given up
        raise _gone(address) from None


def _has(client: Any, worker: str, name: str) -> bool:
    how = {"workers": [worker], "on_error": "ignore", "callback_timeout": LAST}
    try:
        return any(client.run(is_prepared, name, **how).values())
    except TimeoutError:
        return False


def _asked(name: str) -> Callable[[bytes], Any]:
    """A function that answers a case; a worker without the study passes it on, as None.

    It travels as it is, for schedulers and workers without the package.
    """
    pause = PAUSE

    def asked(case: bytes) -> Any:
        with suppress(ImportError):
            from armdesign.sweeps.worker import answer, is_prepared

            if is_prepared(name):
                return answer(name, pickle.loads(case))
        time.sleep(pause)
        return None

    return asked


@dataclass
class _Watch:
    """What a scheduler tells of its workers.

    Attributes:
        address: of the scheduler.
        died_at: told each case whose worker died.
        say: told when there is no worker, and when one has come.
        named: the cases by their names at the scheduler.
        died_alone: keys of the cases at which a worker died that had nothing else to do.
    """

    address: str
    died_at: Callable[[Case], None]
    say: Callable[[str], None]
    named: dict[str, Case] = field(default_factory=dict)
    died_alone: set[str] = field(default_factory=set)
    _events: deque[Any] = field(default_factory=deque)
    _workers: set[str] = field(default_factory=set)
    _said: bool = False

    def begin(self, client: Any) -> None:
        """Take in what the client's scheduler tells from now on."""
        client.subscribe_topic("all", lambda event: self._events.append(event[1]))
        try:
            self._workers |= set(client.nthreads())
        except (OSError, RuntimeError, AttributeError):
            raise _gone(self.address) from None

    def look(self) -> None:
        """Say what has come since the last look."""
        while self._events:
            event = self._events.popleft()
            action = event.get("action") if isinstance(event, dict) else None
            if action == "add-worker":
                self._workers.add(event["worker"])
            elif action == "remove-worker":
                self._workers.discard(event["worker"])
                lost = _lost(event)
                for case in (self.named[name] for name in lost if name in self.named):
                    self.died_at(case)
                    if len(lost) == 1:
                        self.died_alone.add(case.key)
        if self._said is bool(self._workers):
            self._said = not self._workers
            start = f"waits for a worker; start one with: dask worker {self.address}"
            self.say(start if self._said else "a worker has come")


def _lost(event: dict[str, Any]) -> list[str]:
    """Keys of the tasks that a worker that has died still had to do."""
    return [] if event.get("expected") else [str(k) for k in event.get("processing-tasks") or ()]


def _gone(address: str) -> ArmDesignError:
    remedy = "start it and run the sweep again, which goes on with its journal, if it has one"
    return ArmDesignError("--scheduler", f"{address} is gone", remedy)
