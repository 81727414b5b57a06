"""Which files of earlier runs go and which stay; lists that somebody else wrote."""

import json
from pathlib import Path

import pytest

from pix2face.commands.photograph_jobs import photograph_names
from pix2face.commands.result_folder import LIST_NAME, ResultFolder, read_results


def run(folder: Path, command: str, photographs: dict[str, list[str]]) -> None:
    """Writes the named files for each photograph, whose name is its stem; their content is the photograph's path."""
    results = ResultFolder(folder, command)
    for photograph, files in photographs.items():
        with results.of_photograph(Path(photograph).stem, folder / photograph) as part:
            for name in files:
                (part / name).write_text(photograph)


def contents(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir() if path.name != LIST_NAME}


def test_a_run_replaces_the_files_of_its_photographs_alone(tmp_path: Path) -> None:
    run(tmp_path, "fit", {"a/x.png": ["x-0.json", "x-1.json"], "a/y.png": ["y-0.json"]})
    (tmp_path / "x-2.json").write_text("not ours")
    run(tmp_path, "fit", {"a/x.png": ["x-0.json"]})
    assert contents(tmp_path) == {"x-0.json": "a/x.png", "y-0.json": "a/y.png", "x-2.json": "not ours"}
    run(tmp_path, "fit", {"a/x.png": []})
    assert contents(tmp_path) == {"y-0.json": "a/y.png", "x-2.json": "not ours"}


def test_another_photograph_of_the_name_takes_its_place(tmp_path: Path) -> None:
    run(tmp_path, "fit", {"a/x.png": ["x-0.json", "x-1.json"]})
    run(tmp_path, "fit", {"b/x.png": ["x-0.json"]})
    assert contents(tmp_path) == {"x-0.json": "b/x.png"}


def test_a_photograph_that_has_another_name_now_leaves_nothing_under_the_old_one(tmp_path: Path) -> None:
    results = ResultFolder(tmp_path, "fit")
    with results.of_photograph("x.2", tmp_path / "b/x.png") as part:
        (part / "x.2-0.json").write_text("old")
    run(tmp_path, "fit", {"b/x.png": ["x-0.json"]})
    assert contents(tmp_path) == {"x-0.json": "b/x.png"}


def test_another_command_keeps_its_files(tmp_path: Path) -> None:
    run(tmp_path, "fit", {"x.png": ["x-0.json", "x-0-maps.png", "x-1.json", "x-1-maps.png"]})
    run(tmp_path, "predict", {"x.png": ["x-0.npz", "x-0-maps.png", "x-1-maps.png"]})
    run(tmp_path, "fit", {"x.png": ["x-0.json", "x-0-maps.png"]})
    assert set(contents(tmp_path)) == {"x-0.json", "x-0.npz", "x-0-maps.png", "x-1-maps.png"}
    run(tmp_path, "predict", {"x.png": ["x-0.npz"]})
    assert set(contents(tmp_path)) == {"x-0.json", "x-0.npz", "x-0-maps.png"}


def test_what_fails_halfway_leaves_the_earlier_results(tmp_path: Path) -> None:
    run(tmp_path, "fit", {"x.png": ["x-0.json", "x-1.json"]})
    before = contents(tmp_path)

    def interrupted() -> None:
        with ResultFolder(tmp_path, "fit").of_photograph("x", tmp_path / "x.png") as part:
            (part / "x-0.json").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert contents(tmp_path) == before


def test_the_list_does_not_grow_with_the_runs(tmp_path: Path) -> None:
    for _ in range(4):
        run(tmp_path, "fit", {"x.png": ["x-0.json"]})
    assert (tmp_path / LIST_NAME).read_text().count("\n") == 2
    (own,) = read_results(tmp_path)
    assert (own.command, own.photograph, own.name, own.files) == ("fit", "x.png", "x", ("x-0.json",))


@pytest.mark.parametrize(
    "line",
    ["", "[]", "{", "[" * 100_000, '{"command": "fit"}', '{"command": 1, "photograph": 2, "name": 3, "files": []}'],
)
def test_a_list_that_is_none_claims_nothing(tmp_path: Path, line: str) -> None:
    (tmp_path / LIST_NAME).write_text(line + "\n")
    assert read_results(tmp_path) == []
    run(tmp_path, "fit", {"x.png": ["x-0.json"]})
    assert len(read_results(tmp_path)) == 1


def test_a_list_claims_no_file_elsewhere_and_no_folder(tmp_path: Path) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "mine.txt"
    (out / "folder").mkdir(parents=True)
    elsewhere.write_text("mine")
    files = ["../mine.txt", str(elsewhere), "..", ".", "", "folder", 3]
    line = {"command": "fit", "photograph": "x.png", "name": "x", "files": files}
    (out / LIST_NAME).write_text(json.dumps(line) + "\n")
    run(out, "fit", {"x.png": ["x-0.json"]})
    assert elsewhere.read_text() == "mine"
    assert (out / "folder").is_dir()


def test_names_are_told_apart_in_the_order_of_the_call() -> None:
    names = ("x.jpg", "a/x.png", "b/X.png", "x.2.png", "y.png")
    assert photograph_names([Path(name) for name in names]) == ["x", "x.3", "X.4", "x.2", "y"]
    assert len(set(photograph_names([Path("x.png")] * 2000))) == 2000
