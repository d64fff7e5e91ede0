# `make demo` and `make test` do all their set-up themselves; `make help` lists the other targets.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo test install lint format asan asan-python tsan tsan-python bench fuzz fuzz-guided stubs docs wheel clean
.PHONY: lint-ruff lint-mypy lint-clang-format lint-clang-tidy cpp-build cpp-tests pytest

export PYTHON ?= python3
# Every build is kept by ccache, where there is one, for all checkouts of the machine.
export CMAKE_CXX_COMPILER_LAUNCHER ?= $(shell command -v ccache)
export CCACHE_SLOPPINESS ?= pch_defines,time_macros
export CCACHE_BASEDIR ?= $(CURDIR)
export CCACHE_NOHASHDIR ?= true
VENV := .venv
PYTHON_BUILD := build/python
DEMO_FOLDER ?= sfmcpp-demo
CLANG_TIDY_JOBS ?= $(shell nproc)
# Two processes for all tests: one for each, as ctest starts them, takes minutes under the sanitizers.
TEST_PROCESSES ?= 2

BUILD_PACKAGES := g++ cmake ninja-build git libeigen3-dev libsuitesparse-dev libopenblas-dev libgtest-dev libbenchmark-dev
LINT_PACKAGES := clang-format clang-tidy

# Stamps: what is newer than its stamp is set up again, nothing else is.
BUILD_PACKAGES_STAMP := build/stamps/build-packages
LINT_PACKAGES_STAMP := build/stamps/lint-packages
VENV_STAMP := $(VENV)/stamp-created
INSTALL_STAMP := $(VENV)/stamp-installed

SOURCES := $(shell find CMakeLists.txt pyproject.toml cpp python -type f -not -name '*.pyc' -not -name '*.so')
CPP_FILES = $(shell find cpp bench tests examples -name '*.hpp' -o -name '*.h' -o -name '*.cpp')

with_python = -DSFMCPP_BUILD_PYTHON=ON -DPYBIND11_FINDPYTHON=ON -DPython_EXECUTABLE=$(CURDIR)/$(VENV)/bin/python \
  -Dpybind11_DIR=$$($(VENV)/bin/python -m pybind11 --cmakedir)

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-12s %s\n", $$1, $$2}' Makefile

demo: install ## set up, build, and solve the circular scene into ./sfmcpp-demo
	$(VENV)/bin/sfmcpp demo -o $(DEMO_FOLDER)
	@echo "make demo: see $(CURDIR)/$(DEMO_FOLDER)/view.html and scene.png"

test: cpp-tests pytest ## set up, build, and run the C++ and the Python tests

pytest: install
	$(VENV)/bin/pytest --numprocesses $(TEST_PROCESSES) --dist loadfile

install: $(INSTALL_STAMP) ## set up, and install the package with its extras into .venv

lint: lint-ruff lint-mypy lint-clang-format lint-clang-tidy ## ruff, mypy, clang-format and clang-tidy

lint-ruff: install
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check

lint-mypy: install
	$(VENV)/bin/mypy

lint-clang-format: $(LINT_PACKAGES_STAMP)
	@clang-format --dry-run -Werror $(CPP_FILES)

# Only set up, for the compile command of every file: what is installed was compiled several in one.
lint-clang-tidy: install $(LINT_PACKAGES_STAMP)
	cmake -B build/lint -G Ninja -DCMAKE_EXPORT_COMPILE_COMMANDS=ON $(with_python) > build/lint.log || { cat build/lint.log; exit 1; }
	$(VENV)/bin/python tools/clang_tidy.py build/lint $(CLANG_TIDY_JOBS)

format: install $(LINT_PACKAGES_STAMP) ## rewrite all sources in the project's format
	$(VENV)/bin/ruff check --fix --select I
	$(VENV)/bin/ruff format
	clang-format -i $(CPP_FILES)

# The tests and benchmarks share the objects of the core with the Python module: one folder, one build.
cpp-build: install
	cmake --build $(PYTHON_BUILD)

run_cpp_tests = processes=(); for shard in $$(seq 0 $$(($(TEST_PROCESSES) - 1))); do \
	  GTEST_BRIEF=1 GTEST_TOTAL_SHARDS=$(TEST_PROCESSES) GTEST_SHARD_INDEX=$$shard $(PYTHON_BUILD)/tests/cpp/sfmcpp_tests$(1) & processes+=($$!); \
	done; for process in "$${processes[@]}"; do wait "$$process"; done; \
	if [ -x $(PYTHON_BUILD)/tests/cpp/sfmcpp_fault_tests$(1) ]; then GTEST_BRIEF=1 $(PYTHON_BUILD)/tests/cpp/sfmcpp_fault_tests$(1); fi

cpp-tests: cpp-build
	$(call run_cpp_tests,)
	ctest --test-dir $(PYTHON_BUILD) --label-regex bench --output-on-failure

bench: cpp-build ## the C++ benchmarks
	ctest --test-dir $(PYTHON_BUILD) --label-regex bench --verbose

counts: cpp-build ## instructions, data references and allocations of a few steps, against bench/counts.json
	@tools/install_packages.sh valgrind || echo "make counts: no valgrind"
	$(VENV)/bin/python bench/counts.py compare $(PYTHON_BUILD)/bench/cpp/sfmcpp_counts

record-counts: cpp-build ## write bench/counts.json anew
	tools/install_packages.sh valgrind
	$(VENV)/bin/python bench/counts.py record $(PYTHON_BUILD)/bench/cpp/sfmcpp_counts

asan: ## the C++ tests with a core under the address and undefined-behaviour sanitizers
tsan: ## the C++ tests that use threads, with a core under the thread sanitizer

# Nine seeds and shares of outliers are asked of the plain core: a sixth of the sanitizers' time, and the code of one seed.
asan tsan: export GTEST_FILTER := -LossAuto.EndsWhere*
asan tsan: install
	cmake --build $(PYTHON_BUILD) --target sfmcpp_tests_$@ sfmcpp_fault_tests_$@
	$(call run_cpp_tests,_$@)

asan-python: install ## the Python tests of the bindings under these sanitizers
tsan-python: install ## the same under the thread sanitizer

asan-python tsan-python:
	cmake --build $(PYTHON_BUILD) --target _core_$(@:-python=)
	tools/sanitized_pytest.sh $(@:-python=) $(CURDIR)/$(VENV)/bin/python $(PYTHON_BUILD)/cpp/$(@:-python=) tests/python/bindings \
	  --numprocesses $(TEST_PROCESSES) --dist loadfile

FUZZ_INPUTS ?= 1000000
fuzz: install ## every reader on a million damaged files (FUZZ_INPUTS), of FUZZ_SEED
	$(VENV)/bin/python tools/mutate_inputs.py --inputs $(FUZZ_INPUTS) --seed $(or $(FUZZ_SEED),0)

FUZZ_SECONDS ?= 60
fuzz-guided: install ## every reader for FUZZ_SECONDS, led by coverage
	$(VENV)/bin/pip install --quiet atheris
	$(VENV)/bin/python tools/guided_fuzz.py --seconds $(FUZZ_SECONDS)

stubs: install ## write python/sfmcpp/_core.pyi anew from the installed module
	tools/make_stub.sh $(VENV)/bin/python python/sfmcpp/_core.pyi

docs: $(VENV)/stamp-docs ## run the code of the pages in docs, and make the website build/docs/html of them
	$(VENV)/bin/python docs/run_pages.py build/docs

$(VENV)/stamp-docs: $(INSTALL_STAMP)
	$(VENV)/bin/pip --disable-pip-version-check --quiet install 'sfmcpp[docs]'
	@touch $@

WHEEL_PYTHONS ?= $(PYTHON)
wheel: $(BUILD_PACKAGES_STAMP) ## wheels for this machine into build/wheels, tried (WHEEL_PYTHONS="python3.11 python3.12")
	tools/make_wheels.sh build/wheels $(WHEEL_PYTHONS)

clean: ## remove all that was built, .venv included
	rm -rf build $(VENV) $(DEMO_FOLDER) .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find python tests bench -name __pycache__ -type d -exec rm -rf {} +

$(BUILD_PACKAGES_STAMP):
	tools/install_packages.sh $(BUILD_PACKAGES)
	@mkdir -p $(@D) && touch $@

$(LINT_PACKAGES_STAMP):
	tools/install_packages.sh $(LINT_PACKAGES)
	@mkdir -p $(@D) && touch $@

$(VENV_STAMP): $(BUILD_PACKAGES_STAMP)
	tools/make_venv.sh $(VENV)
	@touch $@

$(INSTALL_STAMP): $(VENV_STAMP) $(SOURCES)
	tools/install_package.sh $(VENV) $(PYTHON_BUILD)
	@touch $@
