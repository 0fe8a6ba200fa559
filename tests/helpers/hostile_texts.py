"""Hostile texts: TOML of scenarios, campaigns and maps with values, keys, lines, letters and encodings changed."""

import random
import re

WORDS = ("0", "-1", "1", "3", "1e308", "-1e308", "nan", "inf", "-inf", "true", "[]", "{}", "[[]]", "''", '"x"',
         "2020-01-01", "10:00:00", "[{}]", "9" * 400, "1e-320", "0x7fffffffffffffff", "1_0", '"\\u0000"',
         '"elevator.left"', "1.5", "[1, 'a']", "{a = 1}", "99999999999999999999", '"' + "x" * 3000 + '"', "=", "", "#",
         '"../../etc/passwd"', "-9223372036854775808", "[nan]", "[1, 2, 3]", "['iotsekf']", '"/dev/zero"', '"."',
         '"\\ud800"', '"\\uFFFF"', "'''", '"a\\nb"', "{low = 1, high = 0}", "{low = 0, high = inf}", "{step = 0}",
         "[0.5, 1.0]", '"all"', '"[bold]"', "1e3", "20000", "5000000")  # fmt: skip
NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?![\w.])")
LETTERS = "\x00\n\r\t\\\"'[]{}=.,é\ufeff\u202e#"


def mangled(rng: random.Random, text: str) -> str:
    """Return TOML text with a few of its values, keys or lines changed."""
    lines = text.splitlines() or [""]
    for _ in range(rng.choice((1, 1, 2, 3))):
        k = rng.randrange(len(lines))
        given = [i for i, line in enumerate(lines) if "=" in line and not line.lstrip().startswith("#")]
        what = rng.random()
        if what < 0.3 and given:
            k = rng.choice(given)
            lines[k] = NUMBER.sub(lambda found: _other(rng, found[0]), lines[k])
        elif what < 0.6 and given:
            k = rng.choice(given)
            lines[k] = f"{lines[k].split('=')[0]}= {rng.choice(WORDS)}"
        elif what < 0.7:
            lines.insert(k, rng.choice(lines))
        elif what < 0.75:
            lines[k] = lines[k].replace(rng.choice("aeiou.[="), rng.choice("xyz.[]{}=\"'"), 1)
        elif what < 0.8:
            lines.insert(k, rng.choice(("[x]", "[[faults]]", "[faults]", "a.b.c = 1", "[flight]", "[draw]", "[grid]")))
        elif what < 0.9:
            del lines[k]
            lines = lines or ["x"]
        else:
            at = rng.randrange(len(lines[k]) + 1)
            lines[k] = lines[k][:at] + rng.choice(LETTERS) + lines[k][at:]
    return "\n".join(lines)


def _other(rng, number):
    """Return another number of the same kind, which may well be allowed."""
    if "." not in number:
        return str(int(number) + rng.choice((-1, 0, 1, 1, 2)))
    return repr(round(float(number) * rng.choice((1.0, 1.0, 0.9, 1.1, 0.5, 2.0, -1.0, 0.0)), 9))


def encoded(rng: random.Random, text: str) -> bytes:
    """Return text as bytes, mostly UTF-8."""
    what = rng.random()
    if what < 0.9:
        return text.encode("utf-8", "surrogatepass")
    raw = text.encode(rng.choice(("utf-16", "utf-16-le", "utf-32", "utf-8-sig", "cp500", "utf-7")), "replace")
    at = rng.randrange(len(raw) + 1)
    return rng.choice(
        (raw, raw[:at], raw.replace(b"\n", b"\r\n"), raw[:at] + b"\xff" + raw[at:], raw[:at] + b"\0" * 99)
    )
