"""Work shared over threads."""

import itertools
import threading
import time

import pytest

from pmopt.execution import threads as shared
from pmopt.execution.threads import ordered_map


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 2, 300])
def test_results_come_in_the_order_of_the_items(threads, count):
    def uneven(item):
        time.sleep(0.002 * (item % 7 == 0))
        return item**2

    assert list(ordered_map(uneven, range(count), threads)) == [k**2 for k in range(count)]


def test_all_threads_take_part():
    meeting = threading.Barrier(3, timeout=20)
    assert sum(1 for _ in ordered_map(lambda _: meeting.wait(), range(9), 3)) == 9


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_an_error_comes_after_the_results_before_it(threads):
    def fails(item):
        if item >= 40:
            raise ValueError(item)
        return item

    got = []
    with pytest.raises(ValueError, match="40"):
        got.extend(ordered_map(fails, range(100), threads))
    assert got == list(range(40))


@pytest.mark.parametrize("threads", [1, 3])
def test_an_endless_source_is_read_a_little_ahead_and_left_at_once(threads):
    read = itertools.count()

    def source():
        while True:
            yield next(read)

    before = threading.active_count()
    results = ordered_map(lambda item: item, source(), threads)
    assert list(itertools.islice(results, 1000)) == list(range(1000))
    results.close()
    assert next(read) <= 1000 + 16 * threads + 2
    assert threading.active_count() == before


def test_nobody_waits_at_the_end(monkeypatch):
    """Ctrl-C ends a process beside a thread that is seconds inside a compiler."""
    monkeypatch.setattr(shared, "ending", threading.Event())
    held, free, ended = threading.Event(), threading.Event(), []

    def work(item):
        if threading.current_thread() is threading.main_thread():
            held.wait(20)
            shared.ending.set()
            raise KeyboardInterrupt
        held.set()
        free.wait(20)
        ended.append(item)

    with pytest.raises(KeyboardInterrupt):
        list(ordered_map(work, range(9), 2))
    assert ended == []
    free.set()


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_an_error_of_the_source_comes_after_the_results_before_it(threads):
    def source():
        yield from range(50)
        raise ValueError("no more")

    got = []
    with pytest.raises(ValueError, match="no more"):
        got.extend(ordered_map(lambda item: time.sleep(1e-4) or item, source(), threads))
    assert got == list(range(50))


def test_those_threads_that_there_are_do_the_work(monkeypatch):
    """A system gives no more threads than so many."""
    started = []

    class Rare(threading.Thread):
        def start(self):
            if len(started) == 2:
                raise RuntimeError("can't start new thread")
            started.append(self)
            super().start()

    monkeypatch.setattr(shared, "Thread", Rare)
    assert list(ordered_map(lambda item: item, range(100), 9)) == list(range(100))
    assert len(started) == 2
