"""Recordings as MCAP files of JSON channels (Foxglove); values are read back exactly."""

from __future__ import annotations

import base64
import contextlib
import json
from collections.abc import Callable, Mapping
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uuvsim_cosim.errors import RecordingError
from uuvsim_cosim.orchestrator.master.observer import seconds
from uuvsim_cosim.orchestrator.recording.signals import Signals

if TYPE_CHECKING:
    from mcap.writer import Writer

__all__ = ["read_mcap", "write_mcap"]

_LIBRARY = "uuvsim-cosim"
DRAWN = "foxglove."  # prefix of the schemas of drawings, which are not signals
_Row = tuple[int, int, dict[str, Any]]  # time [ns], sequence, values by name
_DTYPES = {"f8": "number", "i8": "integer", "u8": "integer", "b1": "boolean", "O": "string"}


def write_mcap(
    signals: Signals, file: Path, further: Callable[[Writer], None] | None = None
) -> None:
    """Write one channel for each component, with a JSON schema; time 0 is the log's epoch.

    A message's sequence is its communication point; a number that is not finite is written as
    null. `further` may write additional channels into the same file.
    """
    from mcap.writer import Writer

    groups: dict[str, list[str]] = {}
    for name in signals:
        groups.setdefault(name.rpartition(".")[0], []).append(name)
    nanoseconds = np.rint(signals.time * 1e9).astype(np.int64)
    with file.open("wb") as out:
        writer = Writer(out)
        writer.start(profile="", library=_LIBRARY)
        writer.add_metadata("uuvsim", {"recording": json.dumps(dict(signals.metadata))})
        channels = {}
        for path, names in groups.items():
            schema = json.dumps(_json_schema(path, names, signals)).encode()
            id_ = writer.register_schema(name=path, encoding="jsonschema", data=schema)
            channels[path] = writer.register_channel(
                topic=f"/{path.replace('.', '/')}", message_encoding="json", schema_id=id_
            )
        lists: dict[str, list[object]] = {}  # rows as JSON's values
        for name, values in signals.items():
            kept = values
            if values.dtype.kind == "f" and not np.isfinite(values).all():
                kept = values.astype(object)
                kept[~np.isfinite(values)] = None
            elif values.dtype.kind == "O":  # bytes are written as base64
                flat = [base64.b64encode(v).decode() if isinstance(v, bytes) else v
                        for v in values.flat]  # fmt: skip
                kept = np.array([*flat, None], object)[:-1].reshape(values.shape)
            lists[name] = kept.tolist()
        ticks = (signals.ticks & 0xFFFFFFFF).tolist()
        for k, at in enumerate(nanoseconds.tolist()):
            for path, names in groups.items():
                message = {n.rpartition(".")[2]: lists[n][k] for n in names}
                data = json.dumps(message).encode()
                writer.add_message(
                    channels[path], log_time=at, publish_time=at, sequence=ticks[k], data=data
                )
        if further is not None:
            further(writer)
        writer.finish()


def _json_schema(path: str, names: list[str], signals: Signals) -> dict[str, object]:
    properties: dict[str, object] = {}
    for name in names:
        values = signals[name]
        dtype = "O" if values.dtype.kind == "O" else values.dtype.str[1:]
        scalar: dict[str, object] = {"type": _DTYPES.get(dtype, "number")}
        if dtype == "O" and values.size and isinstance(values.flat[0], bytes):
            scalar["contentEncoding"] = "base64"
        about_text = signals.descriptions.get(name, "")
        description = f"{about_text} [{signals.units.get(name, '')}]".strip()
        shaped = scalar
        if values.ndim == 2:
            n = values.shape[1]
            shaped = {"type": "array", "items": scalar, "minItems": n, "maxItems": n}
        about = {"dtype": dtype, "about": about_text}
        units = {"units": list(signals.element_units.get(name, ()))}
        properties[name.rpartition(".")[2]] = {
            **shaped, "description": description, **about, **units,
        }  # fmt: skip
    return {"title": path, "type": "object", "properties": properties}


# ---- reading ----------------------------------------------------------------------------------


def read_mcap(file: Path) -> Signals:
    """Read a file that `write_mcap` wrote; raises RecordingError for other or incomplete files."""
    from mcap.exceptions import McapError
    from mcap.reader import make_reader

    try:
        with file.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            header = reader.get_header()
            kept = {m.name: m.metadata for m in reader.iter_metadata()}.get("uuvsim")
            if header.library != _LIBRARY or kept is None:
                raise RecordingError(
                    file,
                    f"is an MCAP file of {header.library or 'another program'!r}",
                    "one that `uuvsim export RUN -o FILE.mcap` wrote",
                )
            metadata = json.loads(kept["recording"])
            schemas: dict[str, dict[str, Any]] = {}
            rows: dict[str, list[_Row]] = {}
            for channel_schema, _, message in reader.iter_messages(log_time_order=False):
                if channel_schema is None:
                    raise ValueError("a channel without schema")
                path = channel_schema.name
                if path.startswith(DRAWN):
                    continue
                if path not in schemas:
                    schemas[path] = json.loads(channel_schema.data)["properties"]
                data = json.loads(message.data)
                rows.setdefault(path, []).append((message.log_time, message.sequence, data))
            return _signals(metadata, schemas, rows)
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read ({error.strerror or error})") from error
    except RecordingError:
        raise
    except (McapError, ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        raise _damaged(file, error) from error
    except Exception as error:  # struct.error, those of its decompressors
        raise _damaged(file, error) from error


def _damaged(file: Path, error: Exception) -> RecordingError:
    reason = str(error) or type(error).__name__
    return RecordingError(
        file,
        f"is no MCAP file, or cut off or damaged ({reason})",
        "a whole one, as `uuvsim export RUN -o FILE.mcap` writes",
    )


def _signals(
    metadata: Mapping[str, Any],
    schemas: Mapping[str, Mapping[str, Any]],
    rows: Mapping[str, list[_Row]],
) -> Signals:
    """Return the signals of the messages by channel; raises ValueError for missing messages."""
    nanoseconds = np.zeros(0, np.int64)
    ticks = np.zeros(0, np.int64)
    values: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    element_units: dict[str, tuple[str, ...]] = {}
    descriptions: dict[str, str] = {}
    for path, messages in rows.items():
        nanoseconds = np.array([at for at, _, _ in messages], np.int64)
        ticks = np.array([k for _, k, _ in messages], np.int64)
        # A sequence has 32 bits and begins at 0 again when they are used up.
        ticks = ticks + (np.cumsum(np.diff(ticks, prepend=ticks[:1]) < -(1 << 31)) << 32)
        if len(ticks) != len(next(iter(rows.values()))):
            raise ValueError(f"{path} has {len(ticks)} messages, unlike the others")
        for variable, about in schemas[path].items():
            name = f"{path}.{variable}"
            encoded = (about.get("items") or about).get("contentEncoding") == "base64"
            values[name] = _array([row[variable] for _, _, row in messages], about, encoded)
            element_units[name] = tuple(about.get("units", ()))
            units[name] = ", ".join(dict.fromkeys(element_units[name]))
            descriptions[name] = about.get("about", "")
    time: np.ndarray = nanoseconds / 1e9
    # Nanoseconds are rounded; the number of ticks gives the recorded time exactly, if known.
    with contextlib.suppress(KeyError, ValueError, ZeroDivisionError):
        exact = seconds(ticks, Fraction(str(metadata["tick"])))
        time = exact if np.allclose(exact, time, rtol=0.0, atol=1e-8) else time
    return Signals(time, ticks, values, units, descriptions, dict(metadata), element_units)


def _array(given: list[object], about: Mapping[str, Any], encoded: bool) -> np.ndarray:
    """Return the values of a variable as an array; `encoded`: bytes in base64."""
    dtype = about.get("dtype", "f8")
    if dtype != "O":
        if dtype != "f8":
            return np.array(given, dtype)
        return np.array(given, float) if given else np.zeros(0)  # null becomes NaN
    array = np.empty((len(given), about["minItems"]) if "minItems" in about else len(given), object)
    for k, value in enumerate(given):
        array[k] = value
    if encoded:
        flat = array.reshape(-1)
        flat[:] = [base64.b64decode(v) for v in flat] or None
    return array
