# `make demo` and `make test` are all that a fresh machine needs; the rest is for development.

.PHONY: demo test slow lint format assets convert-all clean

demo:
	./setup.sh
	.venv/bin/sdfprim demo

test:
	./setup.sh dev
	.venv/bin/python -m pytest --numprocesses auto --maxprocesses 4 --dist loadfile --durations 10

slow:
	./setup.sh dev
	.venv/bin/python -m pytest -m slow --durations 10

lint:
	./setup.sh dev
	.venv/bin/python -m pytest tests/test_style.py

format:
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .

assets:
	.venv/bin/python assets/generate.py

# Every glTF under the folder of large test scenes, one report: out/all/report.json.
convert-all:
	find "$${SDFPRIM_ASSETS:-../shared/assets}" -name '*.gltf' -print0 -o -name '*.glb' -print0 \
		| sort -z | xargs -0 .venv/bin/sdfprim convert -o out/all

clean:
	rm -rf .venv build dist out *.egg-info
