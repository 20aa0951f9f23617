"""How long the package takes to be imported, beside the libraries that it cannot do without.

    python benchmarks/start.py

Prints the processor's time of fresh processes, in turn, and what it is of that of the first.
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys

PROGRAMS = {
    "import gymnasium, mujoco": ["-c", "import gymnasium, mujoco"],
    "import sb3_piano": ["-c", "import sb3_piano"],
    "import sb3_piano.envs": ["-c", "import sb3_piano.envs"],
    "import sb3_piano.planning": ["-c", "import sb3_piano.planning"],
    "sb3-piano --help": ["-m", "sb3_piano.cli", "--help"],
}
ROUNDS = 10


def seconds(arguments: list[str]) -> float:
    """Return the processor's time of a program of Python."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Measure in turns, and print least and median times and the median ratio."""
    rounds = [[seconds(arguments) for arguments in PROGRAMS.values()] for _ in range(ROUNDS)]
    print("| | least, s | median, s | ratio |")
    print("|---|---:|---:|---:|")
    for place, name in enumerate(PROGRAMS):
        times = [each[place] for each in rounds]
        ratio = statistics.median(each[place] / each[0] for each in rounds)
        print(f"| `{name}` | {min(times):.2f} | {statistics.median(times):.2f} | {ratio:.2f} |")


if __name__ == "__main__":
    main()
