# make help tells what there is to make.

PYTHON ?= python3
ARGS ?=
PYTEST_ARGS ?=
# As many tests at once; 0 runs them in the process of pytest itself.
PYTEST_WORKERS ?= 2
# Not empty: make run starts the node alone, without the page in the browser.
HEADLESS ?=
LOCK_ARGS ?=

SHELL := /bin/bash
BIN := .venv/bin
LOCK := requirements/lock.txt

SOURCES := setup.py package.xml setup.cfg pyproject.toml resource/cube_sim $(sort \
  $(shell find cube_sim foxglove msg_examples rviz -name __pycache__ -prune -o -type f -print 2>/dev/null))

# The wheels' Python start-up believes to be set up when it finds this.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
# The environment has Fast DDS and nothing else.
unexport RMW_IMPLEMENTATION
# A sourced ROS installation would mix its libraries with those of the environment.
ifdef AMENT_PREFIX_PATH
unexport AMENT_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH
endif
unexport PYTHONHOME
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.DEFAULT_GOAL := setup
.PHONY: setup run test format lock clean help

setup: .venv/package.stamp

# An environment holds absolute paths: in a moved or copied checkout, and without its Python, it is made anew.
ifneq ($(shell test -x $(BIN)/python && cat .venv/deps.stamp 2>/dev/null),$(CURDIR))
.PHONY: .venv/deps.stamp
endif

# The package's stamp lists its sources: a removed file makes none of the others newer.
ifneq ($(shell cat .venv/package.stamp 2>/dev/null),$(SOURCES))
.PHONY: .venv/package.stamp
endif

# What the lock names and nothing else: wheels.
PINNED := --require-hashes --only-binary :all:
# empy has no wheel: the pinned setuptools builds it.
BUILT := --no-binary empy --no-build-isolation

# Does `command`, or says `sentence` and stops.
need = @$(1) || { echo "cube_sim: $(2)" >&2; exit 1; }

.venv/deps.stamp: $(LOCK)
	$(call need,[ "$$(uname -sm)" = 'Linux x86_64' ],ROS 2 comes as wheels for x86-64 Linux only; this is $$(uname -sm).)
	$(call need,command -v $(PYTHON) >/dev/null,there is no '$(PYTHON)' here; CPython 3.10 to 3.14 is needed: make PYTHON=/path/to/python3)
	$(call need,$(PYTHON) -c 'import sys; sys.exit(not 0x30a0000 <= sys.hexversion < 0x30f0000)',CPython 3.10 to 3.14 is needed and '$(PYTHON)' is $$($(PYTHON) --version 2>&1); choose another: make PYTHON=python3.12)
	$(call need,$(PYTHON) -c 'import ensurepip; import venv' 2>/dev/null,'$(PYTHON)' cannot make virtual environments; on Debian and Ubuntu: apt install python3-venv)
	@echo 'cube_sim: installing the pinned environment into .venv, half a minute to two ...'
	@rm -rf .venv
	@$(PYTHON) -m venv .venv
	@# uv needs a tenth of pip's time. It knows nothing of an index configured for pip, and certificates
	@# or proxies may defeat it: pip is the way that always works.
	@awk '/^[^ ]/ {wanted = /^(setuptools|uv)==/} wanted' $(LOCK) > .venv/first.txt
	@$(BIN)/pip install -q $(PINNED) -r .venv/first.txt
	@{ ! $(BIN)/pip config list | grep -q index-url \
	  && $(BIN)/uv pip install -q --python $(BIN)/python $(PINNED) $(BUILT) -r $(LOCK); } >.venv/uv.log 2>&1 \
	|| $(BIN)/pip install -q --use-pep517 $(PINNED) $(BUILT) -r $(LOCK)
	@echo '$(CURDIR)' > $@

# build/ would carry deleted modules into the package. Renamed, the stamp is as old as the start.
.venv/package.stamp: .venv/deps.stamp $(SOURCES)
	@echo 'cube_sim: installing the package ...'
	@echo '$(SOURCES)' > .venv/package.started
	@rm -rf build/lib build/bdist.* cube_sim.egg-info
	@$(BIN)/pip install -q --no-deps --no-build-isolation --no-index .
	@cd .venv && bin/python -m cube_sim.physics.warm_up  # of the installed package, not of the sources here
	@mv .venv/package.started $@

# In a terminal, Ctrl-C is for the node alone: it gets a process group of its own, so that make waits
# for its clean end and ends with the node's exit code. Should make be killed, the node is asked to end.
run: setup
	@run=($(BIN)/$(if $(HEADLESS),sim_node,cube_sim_game) --ros-args -p live_line:=true -p record:=true -p bag_directory:=recordings -p scenario:=first_throws $(ARGS)); \
	read -r _ _ _ _ group _ _ foreground _ < /proc/self/stat; \
	[ "$$group" = "$$foreground" ] || exec "$${run[@]}"; \
	set -m; $$(command -v setpriv >/dev/null && echo setpriv --pdeathsig TERM) "$${run[@]}"; exit

test: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pytest -n $(PYTEST_WORKERS) $(PYTEST_ARGS)

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

lock:
	@$(PYTHON) -m venv build/lock
	@build/lock/bin/pip install -q uv
	@build/lock/bin/uv pip compile -q --universal --python-version 3.10 --generate-hashes \
	  --no-emit-index-url --no-emit-find-links --no-header $(LOCK_ARGS) \
	  requirements/*.in -o $(LOCK)

clean:
	rm -rf .venv build install log dist cube_sim.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find cube_sim test -name __pycache__ -prune -exec rm -rf {} +

define HELP
make run      install what is missing, start the simulation and its page (Ctrl-C ends both)
              the node alone: make run HEADLESS=1
              more arguments for the node: make run ARGS='-p real_time_factor:=0.5'
make test     install what is missing, run every check and test
              more arguments for pytest: make test PYTEST_ARGS='-k bag -x'
make setup    install only: .venv/bin then has every executable
make format   put the code into its standard form
make lock     write requirements/lock.txt anew; newer versions: LOCK_ARGS=--upgrade
make clean    remove all that make and colcon have made
PYTHON=...    another Python for .venv, 3.10 to 3.14
endef

help:
	$(info $(HELP))
	@:
