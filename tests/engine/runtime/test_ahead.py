"""Work ahead of its use: all of it before `wait` returns, none after `stop`, and its errors where it is needed."""

from threading import current_thread, main_thread
from time import sleep

import pytest

from lensfield.engine.runtime.ahead import Ahead


def counted(taken, steps):
    for number in range(steps):
        taken.append((number, current_thread()))
        yield


def endless(taken):
    while True:
        taken.append(current_thread())
        yield


def test_all_steps_are_taken_in_another_thread_before_the_wait_ends():
    taken = []
    with Ahead() as ahead:
        ahead.begin(counted(taken, 5))
        ahead.wait()
    assert [number for number, _ in taken] == list(range(5))
    assert main_thread() not in {thread for _, thread in taken}


def test_waiting_for_nothing_ends_at_once():
    with Ahead() as ahead:
        ahead.wait()


def test_the_end_of_the_block_ends_the_steps():
    taken = []
    with pytest.raises(KeyboardInterrupt), Ahead() as ahead:
        ahead.begin(endless(taken))
        while not taken:
            sleep(0.001)
        raise KeyboardInterrupt
    assert not taken[0].is_alive()


def test_new_steps_replace_earlier_ones():
    taken, earlier = [], []
    with Ahead() as ahead:
        ahead.begin(endless(earlier))
        ahead.begin(counted(taken, 2))
        ahead.wait()
    assert len(taken) == 2 and earlier[0] != taken[0][1]


def test_an_error_is_raised_by_the_wait_once():
    def failing():
        yield
        raise ValueError("not the lens")

    with Ahead() as ahead:
        ahead.begin(failing())
        with pytest.raises(ValueError, match="not the lens"):
            ahead.wait()
        ahead.wait()


def test_an_error_of_stopped_steps_is_not_raised():
    def failing():
        raise ValueError
        yield

    with Ahead() as ahead:
        ahead.begin(failing())
        ahead.stop()
        ahead.wait()
