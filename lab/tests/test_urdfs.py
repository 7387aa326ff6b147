"""Tests of the survey of URDFs."""

from lab.urdfs import UrdfsCommand, run

SHAPE = "<collision><geometry>{}</geometry></collision>"
ROBOT = '<robot name="r"><link name="a">{}</link></robot>'


def test_every_urdf_is_counted_once_by_how_much_of_it_can_be_used(tmp_path, capsys):
    files = {
        "whole": ROBOT.format(SHAPE.format('<sphere radius="1"/>')),
        "partly": ROBOT.format(SHAPE.format('<mesh filename="gone.stl"/>')),
        "broken": "<robot",
        "below/empty": "<robot/>",
    }
    (tmp_path / "below").mkdir()
    for name, text in files.items():
        (tmp_path / f"{name}.urdf").write_text(text)
    counts = run(UrdfsCommand((tmp_path, tmp_path / "below")))
    assert counts == {"loaded": 1, "without shapes": 1, "refused": 2}
    *lines, total = capsys.readouterr().out.splitlines()
    assert len(lines) == len(files) and total.endswith("2 refused")
    assert all(sum(f"{name}.urdf" in line for line in lines) == 1 for name in files)
