"""What is said of many things is said once, with the names of all."""

from windmark.errors import g1, g2, g3
from windmark.pipeline.alike import alike, left_out, listed


def test_words_that_differ_by_numbers_are_the_same_and_names_are_not_numbers():
    said = [("p1", "57 of 58 markers at T07"), ("p2", "56 of 58 markers at T07"), ("p3", "56 of 58 markers at T08")]
    assert alike(said) == {"57 of 58 markers at T07": ["p1", "p2"], "56 of 58 markers at T08": ["p3"]}


def test_names_are_listed_up_to_five():
    assert listed("point", ["a"]) == "point a"
    assert listed("point", list("abcdefg")) == "points a, b, c, d, e and 2 more"


def test_a_reason_that_the_whole_has_said_is_not_said_again():
    dropped = {"s1": "3 spots", "s2": "4 spots", "x": "unread"}
    assert left_out(dropped, "no picture: 3 spots") == ["Could not take part: s1, s2 (for this reason); x (unread)"]
    assert left_out({}, "nothing") == []
    five = left_out({str(k): f"because of {chr(97 + k)}" for k in range(5)}, "")
    assert five[0].endswith("; and 1 more")


def test_numbers_of_messages_have_no_powers_of_ten_below_a_million():
    assert [g2(123.4), g2(-1.0e5), g3(12345.0), g1(27.0), g2(0.0123)] == ["120", "-100000", "12300", "30", "0.012"]
    assert [g2(2.5e7), g2(-2.5e7), g2(float("nan"))] == ["2.5e+07", "-2.5e+07", "nan"]
