# The two commands of the README: `make demo` and `make check`.

CARGO ?= cargo
RELIGHT := $(or $(CARGO_TARGET_DIR),target)/release/relight

.PHONY: demo check fmt clippy walls test doc recipes bench accuracy report deny clean

## Build, bake the real capture in testdata/ and light it anew.
demo:
	$(CARGO) build --release --package relight
	@mkdir -p out
	$(RELIGHT) bake testdata/icon72 -o out/icon72.ktx2 --basis hsh -k 16 --holdout every:6
	$(RELIGHT) render out/icon72.ktx2 --angles 150,25 -o out/icon72_left.png
	$(RELIGHT) render out/icon72.ktx2 --angles 10,25 -o out/icon72_right.png
	@echo "Relit pictures: out/icon72_left.png out/icon72_right.png"
	@if [ -n "$$DISPLAY$$WAYLAND_DISPLAY" ] && command -v xdg-open >/dev/null; then xdg-open out/icon72_left.png; \
	elif [ "$$(uname)" = Darwin ]; then open out/icon72_left.png; fi

## Everything that has to pass: format, lints, tests (crate walls among them), documentation.
check: fmt clippy test doc

fmt:
	$(CARGO) fmt --all -- --check

clippy:
	$(CARGO) clippy --workspace --all-targets --locked -- -D warnings

## Fails when a crate has a dependency that the table in docs/architecture.md does not list.
walls:
	$(CARGO) test --package relight --test walls --locked

test:
	$(CARGO) test --workspace --locked

doc:
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --workspace --no-deps --locked

## The recipes of examples/ with build systems and farm engines, which pip brings to target/recipes; skips what can't be had.
recipes:
	$(CARGO) build --package relight --locked
	tests/recipes/run "$${CARGO_TARGET_DIR:-target}/debug/relight"

## Time, memory and stages beside djpeg; wants ../shared/data/relief1024 and djpeg (libjpeg-turbo-progs).
bench:
	$(CARGO) bench --package relight --bench bake
	$(CARGO) bench --package relight-lights --bench paths

## What each basis and each block format reaches, as the tables of docs/accuracy.md.
accuracy:
	$(CARGO) bench --package relight --bench accuracy
	$(CARGO) bench --package relight --bench textures
	$(CARGO) bench --package relight-texture --bench blocks

## Writes the generated part of docs/accuracy.md, from testdata/ alone.
report:
	$(CARGO) bench --package relight --bench report

## Licences, bans and sources of all dependencies, where cargo-deny is installed.
deny:
	@if command -v cargo-deny >/dev/null; then $(CARGO) deny check licenses bans sources; \
	else echo "cargo-deny is not installed; cargo install cargo-deny brings it"; fi

clean:
	$(CARGO) clean
	rm -rf out
