"""Messages are one line that can be read, whatever they quote."""

import pytest

from usvauv.kernels.errors import LONGEST, SHOWN, UserError, blaming, in_words, wrong_return


@pytest.mark.parametrize("excess", [-1, 0, 1, 5000])
def test_the_middle_of_a_long_message_is_left_out(excess):
    message = "".join(chr(ord("a") + n % 26) for n in range(LONGEST + excess))
    shown = str(UserError(message))
    if excess <= 0:
        assert shown == message
    else:
        begin, end = shown.split(" … ")
        assert len(begin) == len(end) == LONGEST // 2
        assert message.startswith(begin)
        assert message.endswith(end)


def test_what_cannot_be_printed_is_written_as_python_does():
    assert str(UserError("a\nb\x1b[2Jc ä\u202e'\"")) == "a\\nb\\x1b[2Jc ä\\u202e'\""


def test_in_words():
    assert in_words(ValueError("one\n  two\tthree")) == "ValueError: one two three"
    taichi = (
        'File "a.py", line 1:\nouter\nFile "b.py", line 2:\n    x = y\n    ^^^^^ ~\nat first\nName "y" is unknown\n'
    )
    assert in_words(NameError(taichi)) == 'NameError: File "b.py", line 2: Name "y" is unknown'
    assert in_words(NameError('File "b.py", line 2:\nreason\n   ^\n')) == 'NameError: File "b.py", line 2: reason'
    assert in_words(NameError('File "b.py", line 2:\n')) == 'NameError: File "b.py", line 2:'
    assert in_words(OSError("n" * SHOWN)) == "OSError: " + "n" * SHOWN
    assert in_words(OSError("n" * (SHOWN + 1))) == "OSError: " + "n" * SHOWN + " …"


def test_blame():
    class Wrong(UserError):
        pass

    for raised in (ZeroDivisionError("no"), SystemExit("no")):
        where = r"in .*test_errors\.py, line \d+ \(set USVAUV_TRACEBACK=1"
        with pytest.raises(Wrong, match=f"^rule: raised {type(raised).__name__}: no, {where}"), blaming("rule", Wrong):
            raise raised
    for raised in (UserError("plain"), KeyboardInterrupt()):
        with pytest.raises(type(raised)) as caught, blaming("rule", Wrong):
            raise raised
        assert caught.value is raised
    assert wrong_return("rule", [1, 2], "a number") == "rule: returned [1, 2]: must be a number"
    assert len(wrong_return("", "n" * 900, "")) < 250
