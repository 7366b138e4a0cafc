"""The interactive side: culling in a pyvista plotter, and a viewer that shows what every stage does.

What can be tested without a window (state, keys, text, pictures of the heads-up display) is kept apart from what needs
VTK.
"""
