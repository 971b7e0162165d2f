"""The source `policy:FILE.npz`: a trained policy as a component, read where it lies."""

from __future__ import annotations

import json
from dataclasses import astuple
from pathlib import Path
from urllib.parse import parse_qsl, urlencode

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.training.loading import policy_path
from uuvsim_cosim.orchestrator.system.sources import ModelSource

__all__ = ["source"]


def source(text: str, base: Path) -> ModelSource:
    """Resolve ``policy:FILE.npz`` or ``policy:FILE.npz?option=value``; the scheme's entry point.

    A shipped policy may be named, ``policy:source_sac``. A path is resolved in the current folder
    first, then in the folder of the system.
    """
    name, _, query = text.removeprefix("policy:").partition("?")
    given = Path(name).expanduser()
    for file in (given, base / given):
        if name and file.is_file():
            return _model(file, query)
    try:
        file = policy_path(name)
        if not file.is_file():
            raise InputInvalid(f"{name!r}", "is a folder", "policy:FILE.npz")
    except InputInvalid as error:
        raise InputInvalid(f"source {text!r}: {error}") from None
    return _model(file, query)


def _model(file: Path, query: str) -> ModelSource:
    """Declare the policy as `uuvsim export-policy` does, with actions in units unless `plain`."""
    from uuvsim_cosim.learn.deployment.export import in_units
    from uuvsim_cosim.learn.policies.policy import Policy

    options = {"file": str(file.absolute())}
    given = dict(parse_qsl(query, keep_blank_values=True))
    if given.get("plain", "0") == "0" and "action" not in given:
        policy = Policy.load(file)
        scaled = in_units(policy)
        if scaled is not policy:
            options["action"] = json.dumps([list(astuple(one)) for one in scaled.action])
            options["action_step"] = str(scaled.settings["action_step"])
    return ModelSource(f"model:policy?{urlencode({**options, **given}, safe='/')}")
