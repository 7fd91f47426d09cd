"""The detail network: local, at the photo's own resolution; it corrects the global maps by what a patch shows.

`network.py` has the layers, `inputs.py` what it reads, `first_look.py` the global network's and the trunk's part of
that, `losses.py` what it learns by, `photos.py` and `stage.py` how it is trained, `trial.py` the weights of the
experiments that came before.
"""
