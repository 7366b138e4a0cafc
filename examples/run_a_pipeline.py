"""
Run a pipeline and read its records
===================================

A walk through a small city: what each stage tested and hid, what it cost, and whether anything visible was lost.
"""

# %%
# Scenes come by name from the registry, with camera paths. The same seed gives the same city.

from scenegraph import Pipeline, registry
from scenegraph.render.item_buffer import ItemBuffer

scene = registry().scene("city").build(buildings=150, views=6)
snapshot = scene.snapshot()
print(snapshot.n, "drawables,", f"{int(snapshot.triangles[0].sum()):,}", "triangles")

# %%
# A pipeline is a list of stages in text form. Every frame carries a record of what each stage did.

truth = ItemBuffer(snapshot)
pipeline = Pipeline.parse("frustum | contribution(pixels=4)")
print(f"{pipeline.text!r} is {pipeline.guarantee.value}")

with pipeline.open(snapshot):
    for view in scene.paths["street"]:
        frame = pipeline.run(view)
        exact = truth.render(view).visible
        stages = ", ".join(f"{s.name} tested {s.tested} and hid {s.hidden}" for s in frame.record.stages)
        lost = int((exact & ~frame.visible).sum())
        print(f"frame {frame.index}: {stages}; {frame.visible_count} left, {exact.sum()} visible, {lost} lost")

# %%
# Each row knows which stage hid it, and by what name it can be found in the graph.

by = frame.hidden_by()
for number, stage in enumerate(pipeline.stages):
    rows = (by == number).nonzero()[0][:2]
    print(f"{stage.name} hid, among others:", *snapshot.names(rows))

# %%
# Times differ from run to run; their parts always add up: the stages and the host's own share are the whole.

record = frame.record
parts = sum(s.ms for s in record.stages) + record.host_ms
print("the parts add up to the whole:", abs(parts - record.cull_ms) < 1e-6)
