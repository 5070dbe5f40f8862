# $(eval $(call relight_bake,KEY,JOB,ASSET[,OPTIONS])) makes ASSET from JOB with GNU make 4. KEY is a word of its own for each asset, for files in
# $(relight_state). JOB and ASSET are written as in a rule: space `\ `; `#` is $(hash), as `\#` would be read twice. Names with % or $ or
# two spaces in a row, and what a shell takes for its own ('"&;()<>|*?[]), are beyond this file.
#   - The stamp is what Make looks at: a bake that changes nothing leaves the asset's time, and the stamp says that it was baked.
#     `ASSET: stamp ;` has a recipe, an empty one, so that Make looks at the asset's time again after the bake.
#   - `+` lends the bake make's jobserver: `make -j8` bakes with eight threads in all.
#   - The depfile's rule is for the asset; its first line is exchanged for the stamp's.
relight ?= relight
relight_state ?= out/.relight
relight_cache ?= $(relight_state)/cache
hash := \\\#

define relight_bake
$(3): $$(relight_state)/$(1).stamp ;
$$(relight_state)/$(1).stamp: $(2)
	@mkdir -p $$(relight_state)
	+$$(relight) bake $(2) -o $(3) $(4) --cache $$(relight_cache) --depfile $$(relight_state)/$(1).read
	@sed '1s|.*|$$@: \\|' $$(relight_state)/$(1).read >$$(relight_state)/$(1).d
	@touch $$@
-include $$(relight_state)/$(1).d
endef
