"""Tables in Markdown."""

from foresee.infra.markdown import markdown, records


def test_cells_are_padded_and_the_first_row_is_the_header():
    assert markdown([["map", "n"], ["hall", "12"]]) == "| map  | n  |\n|------|----|\n| hall | 12 |"


def test_a_bar_in_a_name_starts_no_cell():
    (_, _, row) = records([{"map": "a|b", "n": 1}]).splitlines()
    assert row == r"| a\|b | 1 |"


def test_no_rows_make_no_table():
    assert records([]) == ""
