# `make demo` and `make test` are all that a fresh machine needs; the rest is for development.

.PHONY: demo test slow lint format assets clean

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

clean:
	rm -rf .venv build dist out *.egg-info
