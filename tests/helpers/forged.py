"""Logs with right checksums and wrong contents: a log written again with something changed."""

import numpy as np

from cosim.log import LogWriter, Topic


def forge(log, path, *, attachments=None, samples=(), metadata=None, result=None, gap=0, dt_ns=None, renamed=()):
    """Write an open log to `path` with attachments {name: bytes or None} and samples (topic, field, value) changed.

    `renamed` are {topic: another name, None to leave it out}, `gap` is a number of ticks that are missing after the
    first 50, `dt_ns` another tick.
    """
    topics, columns, at = [], [], 0
    renamed = dict(renamed)
    for info in (info for name, info in log.topics.items() if renamed.get(name, name)):
        index = np.arange(len(info.fields)) + at
        topics.append(Topic(renamed.get(info.name, info.name), info.fields, info.units, index, info.every, info.group,
                            "" if info.name in renamed else info.channel))  # fmt: skip
        values = log.array(info.name).copy()
        for topic, field, value in samples:
            if topic == info.name and field in info.fields:
                values[:, info.fields.index(field)] = value
        wide = np.zeros((log.n_ticks, values.shape[1]))
        wide[:: info.every] = values
        columns.append(wide)
        at += values.shape[1]
    held = {k: v for k, v in (log.attachments | (attachments or {})).items() if v is not None}
    kept = {n: log.metadata[n] for n in ("run", "libraries") if n in log.metadata} | (metadata or {})
    held = {k: ("application/octet-stream", v) for k, v in held.items()}
    how = {"dt_ns": dt_ns or log.dt_ns, "rows_per_chunk": 50 if gap else 500, "kept": False}
    made = LogWriter(path, topics, n_values=at, metadata=kept, attachments=held, **how)
    with made as w:
        for k, row in enumerate(np.concatenate(columns, axis=1)):
            if gap and k == 50:
                w.flush()
                [whole] = w._file.chunks
                w._file.chunks[:] = [whole._replace(end_ns=(k + gap - 1) * w.dt_ns)]
                for target in w._blocks:
                    target.at[-1] = k + gap
            w.append(row)
        if gap:
            w.flush()
            w._file.chunks[0] = whole
        w.close(result={k: v for k, v in log.result.items() if k != "content"} | (result or {}))
    return path
