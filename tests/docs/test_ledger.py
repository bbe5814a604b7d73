"""The ledger of nulls: benches append to it once for each honest record, and its command counts its last lines."""

from benches import hidden, ledger, nulls, outcomes


class Trial:
    """A stand-in for the trial of a bench."""

    def __init__(self, number, **outcome):
        self.key = f"7/{number}"
        self.outcome = {"key": self.key, **outcome}


def run(trial):
    return trial.outcome


def test_a_bench_enters_each_honest_record_once(tmp_path, monkeypatch):
    book = tmp_path / "nulls.csv"
    monkeypatch.setattr(outcomes, "enter", lambda *row: ledger.enter(*row, path=book))
    trials = [
        Trial(0, group=1, names=[], effects=[]),
        Trial(1, group=1, names=[], effects=["tone"], nuisances={"vibration": 0.0, "converter_bits": 0}),
        Trial(2, group=2, names=["cubic"], effects=["cubic"]),
        Trial(3, group=1, names=[], error="stopped"),
    ]
    for _ in range(2):  # an interrupted bench that goes on
        outcomes.run_all(run, trials, tmp_path / "group1.jsonl", 1, hidden.null)
    read = sorted(ledger.entries(book), key=lambda null: null.seed)
    assert [(null.bench, null.regime, null.seed, null.named) for null in read] == [
        ("hidden", "worlds", "7/0", ""),
        ("hidden", "worlds", "7/1", "tone"),
    ]
    assert {null.commit for null in read} == {ledger.commit()}


def test_the_command_holds_the_last_lines_to_one_per_cent(tmp_path, capsys):
    book = tmp_path / "nulls.csv"
    lines = [f"hidden,worlds,{n},abc,{'tone' if n % 68 == 0 else ''}\n" for n in range(2030)]
    book.write_text("bench,regime,seed,commit,named\n" + "".join(lines))
    assert ledger.main([], book) == 0
    assert "29 of the last 2000, at most 29" in capsys.readouterr().out
    assert ledger.main(["--last", "200"], book) == 0
    book.write_text(book.read_text() + "hidden,worlds,2031,abc,cubic\n" * 2)
    assert ledger.main([], book) == 1


def test_the_ledger_of_the_repository_is_read_and_holds():
    assert len(ledger.entries()) >= 300
    assert ledger.main([]) == 0
    assert nulls.null({"effects": [], "false_names": [], "regime": "a-trap"}) == ("nulls", "a-trap", [])
