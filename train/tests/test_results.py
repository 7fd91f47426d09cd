"""tools/results.py: its means are those of `flashmat eval`, and docs/results.md names the model that is committed."""

import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SPEC = importlib.util.spec_from_file_location("results", ROOT / "tools/results.py")
assert SPEC and SPEC.loader
results = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(results)

EVAL = """\
method,class,name,found,albedo_mse_paper,albedo_scaled_mse_paper,normal_mse_paper,roughness_mse_paper,albedo_rmse,\
roughness_rmse,angle_deg,relit_rmse,residual,albedo_n_mse
"int8, refined",wood,"a",wood,0.010000,0.002000,0.003000,0.040000,0.1,0.1,4.0000,0.100000,0.02,0.1
"int8, refined",metal,"b",wood,0.030000,0.004000,0.005000,0.060000,0.1,0.1,6.0000,0.200000,0.02,0.1
constants,wood,"a",wood,0.500000,0.100000,0.010000,0.900000,0.1,0.1,9.0000,0.300000,,0.1
"""
BENCH = """\
median of 3 runs, milliseconds; levels on this CPU: scalar

 size       level threads |   frame     total | workspace
  128      scalar       1 |     1.5      20.0 |   3.9 MiB

network alone
 size       level threads |    median
  128      scalar       1 |   1263.31
"""


def test_accuracy_is_the_mean_over_photos(tmp_path):
    path = tmp_path / "eval.csv"
    path.write_text(EVAL)
    text = results.accuracy(path)
    assert "| int8, refined | 0.0200 | 0.0030 | 0.0040 | 0.0500 | 5.0° | 50 % | 0.150 |" in text
    assert "| constants | 0.5000 | 0.1000 | 0.0100 | 0.9000 | 9.0° | 100 % | 0.300 |" in text
    assert "| metal (1) | 0.0300 | 0.0040 | 0.0050 | 0.0600 | 6.0° | 0 % | 0.200 |" in text


def test_speed_takes_the_first_table_as_it_is(tmp_path):
    path = tmp_path / "bench.txt"
    path.write_text(BENCH)
    text = results.speed(path)
    assert text.splitlines()[0] == "| size | level | threads | frame | total | workspace |"
    assert text.splitlines()[2:] == ["| 128² | scalar | 1 | 1.5 | 20.0 | 3.9 MiB |"]


def test_a_sweep_has_a_column_for_each_strength(tmp_path):
    path = tmp_path / "sweep.csv"
    path.write_text(
        "environment,albedo_mse_paper,albedo_scaled_mse_paper,normal_mse_paper,roughness_mse_paper,class_right,relit\n"
        "0.00,0.01,0.02,0.03,0.04,0.75,0.1\n0.20,0.02,0.02,0.03,0.04,0.5,0.1\n"
    )
    text = results.sweep(path)
    assert "| room / flash | 0 | 0.2 |" in text and "| class | 75 % | 50 % |" in text


def test_files_of_another_kind_are_refused(tmp_path):
    path = tmp_path / "x"
    path.write_text("a,b\n1,2\n")
    for make in (results.accuracy, results.sweep, results.speed):
        with pytest.raises(results.ResultsError):
            make(path)


def test_only_the_section_changes():
    page = "a\n<!-- begin speed -->\nold\n<!-- end speed -->\nb\n<!-- begin sweep -->\nold\n<!-- end sweep -->\n"
    assert results.replaced(page, "speed", "new\\1") == page.replace("speed -->\nold", "speed -->\nnew\\1")
    with pytest.raises(results.ResultsError):
        results.replaced(page, "accuracy", "new")


def test_the_page_names_the_committed_model():
    whole, network = results.model_hashes((ROOT / "models/phone.fmat").read_bytes())
    page = (ROOT / "docs/results.md").read_text()
    assert whole in page and f"network {network}" in page, "run tools/results.py"
