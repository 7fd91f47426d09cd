"""`python -m flashmat_train <stage>`."""

from __future__ import annotations

import argparse
import importlib

STAGES = {
    "procedural": ("data.procedural_pool", "make procedural materials"),
    "train": ("train", "train a network"),
    "detail": ("detail.stage", "train the detail network beside a global one"),
    "classifier": ("classifier", "fit the classifier to the pretrained trunk"),
    "sample-photo": ("sample", "render the sample photo of the quick start"),
    "curves": ("curves", "draw a run's curves"),
    "rates": ("rates", "measure where training time goes"),
    "pack": ("pack", "one compact file of training and validation materials"),
    "export-onnx": ("export_onnx", "make an ONNX file of the network"),
    "mitsuba-check": ("render.mitsuba_check", "compare the renderer with Mitsuba 3"),
    "testset": ("testset", "photos with known maps, rendered by Mitsuba 3"),
    "sweep": ("sweep", "draw the errors against the environment's strength"),
    "golden": ("golden", "write small renders for the Rust renderer's tests"),
    "quant": ("quant", "what int8 costs, on the validation photos"),
    "export": ("export", "make the model file for the Rust engine"),
    "import-model": ("import_model", "make a checkpoint of a model file, to train on from it"),
}


def main(argv: list[str] | None = None) -> None:
    """Parses the stage and its options, and runs it."""
    parser = argparse.ArgumentParser(prog="flashmat_train", description=__doc__)
    stages = parser.add_subparsers(dest="stage", required=True)
    for name, (module, text) in STAGES.items():
        p = stages.add_parser(name, help=text, description=text)
        importlib.import_module(f".{module}", __package__).add_arguments(p)
    args = parser.parse_args(argv)
    importlib.import_module(f".{STAGES[args.stage][0]}", __package__).run(args)


if __name__ == "__main__":
    main()
