"""Cases on a cluster, by dask.distributed: the only door to it.

The study goes to every worker once, also to those that come later. The scheduler gives the cases
of a dead worker to others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from typing import Any

from armdesign.errors import ArmDesignError
from armdesign.sweeps.cases import Case
from armdesign.sweeps.worker import Outcome, Study, answer, died, forget, prepare

PATIENCE = 10.0  # [s] for which a scheduler may be silent at the start
PREFIX = "armdesign-"


def on_cluster(
    study: Study, cases: Sequence[Case], address: str
) -> Iterator[tuple[Case, Outcome]]:
    """Cases with their outcomes, as they come.

    Args:
        study: what the cases share.
        cases: the cases.
        address: of the scheduler, as ``tcp://host:8786``.

    Raises:
        ArmDesignError: dask.distributed is missing, or the scheduler cannot be reached or is gone.
    """
    try:
        from distributed import as_completed
    except ImportError:
        remedy = 'pip install "armdesign[cluster]"'
        raise ArmDesignError("--scheduler", "needs dask.distributed", remedy) from None
    client = _client(address)
    try:
        client.register_plugin(_plugin(study), name=f"{PREFIX}{study.name}")
        named = {f"{PREFIX}{case.key}": case for case in cases}
        futures = [
            client.submit(answer, study.name, case, key=name, pure=False)
            for name, case in named.items()
        ]
        for future in as_completed(futures, loop=client.loop):
            yield named[str(future.key)], _outcome(future, address)
            future.release()
        client.unregister_worker_plugin(f"{PREFIX}{study.name}")
    finally:
        client.close(timeout=PATIENCE)  # which drops what is still to do


def _client(address: str) -> Any:
    from distributed import Client

    try:
        return Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        fault = f"{address} cannot be reached ({type(error).__name__})"
        remedy = "start one with: dask scheduler, and workers with: dask worker ADDRESS"
        raise ArmDesignError("--scheduler", fault, remedy) from None


def _plugin(study: Study) -> Any:
    """Task of every worker that comes: it takes the study."""
    from distributed import WorkerPlugin

    class Prepared(WorkerPlugin):  # type: ignore[misc]
        def setup(self, worker: Any) -> None:
            prepare(study)

        def teardown(self, worker: Any) -> None:
            forget(study)

    return Prepared()


def _outcome(future: Any, address: str) -> Outcome:
    from distributed import KilledWorker

    try:
        outcome: Outcome = future.result()
    except KilledWorker as error:
        return died(1 + int(error.allowed_failures))
    except CancelledError:
        fault = f"{address} is gone"
        raise ArmDesignError("--scheduler", fault, "start it and run the sweep again") from None
    return outcome
