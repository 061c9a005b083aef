# make demo          photos in; their light and the reshaded photos out, under out/
# make test          lint, types, the core, and the built extension in Blender 5.2 and 4.5 as Python modules
# make test-blender  the extension in real Blenders, each in a chroot under .build/ (needs root and Debian or Ubuntu)
# make extension     the zips to install, one a platform, under dist/
# make screenshot    docs/pictures/sidebar.png anew
# make bench         accuracy and speed on scenes of known truth: the table of bench/suite.md
# Each sets up what it needs; what stands is not set up again.

PYTHON := .venv/bin/python
MAIN := .venv/ready
SMOKE := .build/venv-4.5/ready
ZIPS := dist/ready
SOURCES := __init__.py blender_manifest.toml LICENSE $(wildcard README.md) $(shell find core reshade_addon -name '*.py')

SEEDS := dev

.PHONY: bench demo test test-core test-addon lint types extension test-blender test-trixie test-sid screenshot

demo: $(MAIN)
	$(PYTHON) demo_blend/run.py

bench: $(MAIN)
	$(PYTHON) -m reshade.bench.run --seeds $(SEEDS)

# Two at a time: each of them keeps one core busy.
test: lint types
	$(MAKE) --no-print-directory -j2 test-core test-addon

test-core: $(MAIN)
	$(PYTHON) -m pytest -rs tests/core

test-addon: $(ZIPS) $(SMOKE)
	$(PYTHON) -m pytest -rs tests/blender

lint: $(MAIN)
	$(PYTHON) -m ruff check .

types: $(MAIN)
	$(PYTHON) -m mypy

extension: $(ZIPS)

test-blender: $(ZIPS)
	$(MAKE) --no-print-directory -j2 test-trixie test-sid

test-trixie: $(ZIPS)
	$(PYTHON) tools/real_blender.py trixie

test-sid: $(ZIPS)
	$(PYTHON) tools/real_blender.py sid --best-effort

screenshot: $(ZIPS)
	$(PYTHON) tools/real_blender.py trixie --picture docs/pictures/sidebar.png

$(ZIPS): $(MAIN) tools/extension.py $(SOURCES)
	$(PYTHON) tools/extension.py
	@touch $@

$(MAIN): tools/environment.py requirements-blender-5.2.txt requirements-blender-4.5.txt requirements-tools.txt
	python3 tools/environment.py main

$(SMOKE): tools/environment.py requirements-blender-4.5.txt requirements-tools.txt
	python3 tools/environment.py smoke
