"""Work in threads: results and errors, the newest answers and values, and threads that wait."""

import threading
from threading import Event

import pytest

from lensfield.engine.runtime.background_work import Answers, Newest, Worker
from lensfield.engine.runtime.errors import InputError, LensError, Stopped
from lensfield.engine.runtime.waiting import wait_in_thread
from waiting import LAST_RESORT_S, wait_until


def test_work_has_the_result_of_its_call_once_that_has_ended():
    opened = Event()
    work = Worker("test").run(lambda number: opened.wait(LAST_RESORT_S) and 2 * number, 21)
    work.wait(0.0)
    assert not work.done()
    with pytest.raises(TimeoutError):
        work.exception(0.0)
    opened.set()
    assert work.result(LAST_RESORT_S) == 42 and work.done() and work.exception() is None


@pytest.mark.parametrize("error", [InputError("lens", "file", "missing", "choose one"), Stopped()])
def test_errors_of_input_and_stopped_work_remain(error):
    def fail():
        raise error

    work = Worker("test").run(fail)
    for _ in range(2):
        with pytest.raises(type(error)) as caught:
            work.result(LAST_RESORT_S)
    assert caught.value is error and len(caught.traceback) < 5, "the traceback does not grow"


def test_other_errors_are_printed_and_become_one_line(capfd):
    work = Worker("test").run(lambda: 1 / 0)
    assert isinstance(work.exception(LAST_RESORT_S), LensError)
    assert "ZeroDivisionError" in capfd.readouterr().err


def test_a_question_is_answered_once_and_drops_older_ones_that_no_thread_has_begun():
    opened, entered, asked = Event(), Event(), []

    def answer(question):
        asked.append(question)
        entered.set()
        return opened.wait(LAST_RESORT_S) and question

    answers = Answers(answer, 2, Worker("test"))
    first = answers.to(1)
    assert entered.wait(LAST_RESORT_S) and answers.to(1) is first
    dropped, last = answers.to(2), answers.to(3)
    opened.set()
    assert answers.newest is last and last.result(LAST_RESORT_S) == 3
    assert dropped.done() and asked == [1, 3]
    answers.forget()
    assert answers.to(3) is not last


def test_the_oldest_value_is_dropped():
    newest = Newest(2)
    for key, value in (("a", 1), ("b", 2), ("a", 3), ("c", 4)):
        newest.store(key, value)
    assert [newest.get(key) for key in "abc"] == [3, None, 4]
    newest.clear()
    assert newest.get("a") is None


def test_only_one_thread_of_a_kind_waits():
    opened, heard = Event(), []
    for number in range(2):
        wait_in_thread(lambda number=number: opened.wait(LAST_RESORT_S) and heard.append(number), "test of waiting")
    assert len(threads_named("Lensfield test of waiting")) == 1
    opened.set()
    wait_until(lambda: not threads_named("Lensfield test of waiting"))
    assert heard == [0]


def threads_named(name):
    return [thread for thread in threading.enumerate() if thread.name == name]
