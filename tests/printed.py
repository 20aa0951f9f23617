"""Tables that commands print and write."""

import csv


def rows_of(out):
    """Return the cells of the rows of a table that is printed, without its heading."""
    lines = [line for line in out.splitlines() if line.startswith("│")]
    return [[cell.strip() for cell in line.strip("│").split("│")] for line in lines]


def read_csv(path):
    """Return the rows of a table file as dictionaries."""
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
