# make demo        render the sample scene and put it through a real lens
# make test        all tests; BPY=4.5.15 runs the Blender tests on another Blender
# make bench       the paper's figures again, and what accuracy costs (a quarter of an hour)
# make extension   dist/*.zip, to install in Blender
# make bake        what `lensfield lens bake` needs, in .venv-bake (Optiland, 2 GB); make test-bake and bench-bake test and time it
# make lenses      the bundled lenses again, from their prescriptions (half an hour)
# Each makes its own environment on the first run and works offline after that.

BPY ?= 5.0.1
VENV = $(if $(filter 5.0.1,$(BPY)),.venv,.venv-$(BPY))
READY = $(VENV)/.ready
LENS ?= edmund-54852
WAVELENGTHS ?= 400:700:9

BAKE = .venv-bake
BAKE_READY = $(BAKE)/.ready

.PHONY: demo test test-engine test-blender bench extension bake test-bake bench-bake lenses

demo: $(READY)
	$(VENV)/bin/lensfield render sample_scenes/evening_chess.blend --lens $(LENS) --wavelengths $(WAVELENGTHS) \
	    --output demo --report demo/report.json

test: $(if $(filter 5.0.1,$(BPY)),test-engine) test-blender

test-engine: $(READY)
	$(VENV)/bin/python -m pytest -q tests --ignore=tests/blender --ignore=tests/bake

test-blender: $(READY)
	$(VENV)/bin/python -m pytest -q tests/blender

bench: $(READY)
	$(VENV)/bin/python benchmarks/paper_section_4.py build/bench
	$(VENV)/bin/python benchmarks/engine_figures.py

extension: $(READY)
	$(VENV)/bin/python packaging/build_extension.py dist

bake: $(BAKE_READY)
	@echo "$(BAKE)/bin/lensfield lens bake PRESCRIPTION -o LENS.npz"

test-bake: $(BAKE_READY)
	$(BAKE)/bin/python -m pytest -q tests/bake

bench-bake: $(BAKE_READY)
	$(BAKE)/bin/python -W ignore benchmarks/bake_figures.py

lenses: $(BAKE_READY)
	$(BAKE)/bin/python packaging/bake_lenses.py

$(BAKE_READY): pyproject.toml packaging/environment.sh
	packaging/environment.sh $(BAKE) bake

$(READY): pyproject.toml packaging/environment.sh
	packaging/environment.sh $(VENV) $(BPY)
