"""An executor that runs each call at once, in the thread of the caller."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any


class InOrder(Executor):
    """Runs each call before `submit` returns, so that what follows does not depend on any clock."""

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run a call, and return its finished future."""
        future = Future[Any]()
        try:
            future.set_result(call(*args, **kwargs))
        except BaseException as error:
            future.set_exception(error)
        return future
