"""Signals that wait until something is done as a whole."""

import os
import signal

import pytest

from windmark.io import interrupts
from windmark.io.interrupts import interrupts_wait


def test_what_arrives_is_raised_when_the_block_is_done():
    done = []

    def interrupted():
        os.kill(os.getpid(), signal.SIGINT)
        done.append("the rest of the block")

    with pytest.raises(KeyboardInterrupt, match="all of it is there"), interrupts_wait("all of it is there"):
        interrupted()
    assert done


def test_a_block_within_a_block_waits_for_the_outer_one():
    """An inner one that raised at its own end would break the outer one in two."""
    done, before = [], signal.getsignal(signal.SIGTERM)

    def interrupted():
        with interrupts_wait():
            os.kill(os.getpid(), signal.SIGINT)
            done.append("inner")
        done.append("outer")

    with pytest.raises(KeyboardInterrupt), interrupts_wait():
        interrupted()
    assert done == ["inner", "outer"]
    assert signal.getsignal(signal.SIGTERM) is before
    assert interrupts._caught is None


def test_an_error_in_the_block_is_what_is_said_and_handlers_are_as_before():
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(RuntimeError), interrupts_wait():
        raise RuntimeError
    assert signal.getsignal(signal.SIGINT) is before
    with pytest.raises(KeyboardInterrupt), interrupts_wait():  # the next block waits again
        os.kill(os.getpid(), signal.SIGINT)


def test_what_is_ignored_stays_ignored():
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with interrupts_wait():
            os.kill(os.getpid(), signal.SIGTERM)
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGTERM, before)
