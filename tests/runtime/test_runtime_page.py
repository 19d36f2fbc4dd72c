"""The program in docs/runtime.md runs and does what the page says."""

from __future__ import annotations

import re

import numpy as np


def test_the_page_runs(gpu, repository, tmp_path):
    page = (repository / "docs" / "runtime.md").read_text(encoding="utf-8")
    for name, text in re.findall(r"```wgsl\n// (\S+)\n(.*?)```", page, re.DOTALL):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    names = {"__name__": __name__, "root": tmp_path}
    exec(compile(program, "docs/runtime.md", "exec", dont_inherit=True), names)

    expected = names["values"][..., :3] * [1, 0.5, 0.25] * 4
    np.testing.assert_allclose(names["result"][..., :3], expected, rtol=1e-3, atol=1e-6)
    assert names["clipped"].read()[0] == np.count_nonzero((expected > 2).any(axis=-1))
    assert list(names["milliseconds"]) == ["film/expose"]
