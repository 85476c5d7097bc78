"""Words of the command line that do not fit a command: one line that names the fault and where help is."""

from __future__ import annotations

import pytest

from taxelflow.cli import main

FAULTS = {
    "estimate": "missing from taxelflow estimate: RECORDING --out PATH; see taxelflow estimate --help",
    "estimate x.npz --mode online": "invalid choice 'online' for argument '--mode'.",
    "estimate x.npz --condition.window 3": "--out PATH; Unrecognized options: --condition.window 3;",
    "estimate x.npz --out y --gain-x 2": "unrecognized options: --gain-x, 2; Perhaps you meant: --gain FLOAT; see",
    "run rig:stroke --to": "missing value for argument '--to'. Expected 1 values; see taxelflow run --help",
    "score robustness --seeds 1.5": "error parsing --seeds: invalid literal for int() with base 10: '1.5'; see",
    "score": "expected one of {table1, hard, ",
    "info x.npz --bogus 3": "unrecognized options: --bogus, 3; see",
    "design --rates 1": "unrecognized options: --rates, 1; see taxelflow design --help-sweep",
    "sensors --plot": "missing value for argument '--plot'",
}


@pytest.mark.parametrize("words", FAULTS)
@pytest.mark.parametrize("columns", ["40", "200"])
def test_words_that_do_not_fit_are_one_line(words, columns, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", columns)
    assert main(words.split()) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert printed.err.startswith("taxelflow: ")
    assert FAULTS[words] in printed.err
    assert "--help" in printed.err
