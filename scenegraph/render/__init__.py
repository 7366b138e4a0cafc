"""Everything that touches VTK and OpenGL: windows, drawing, the item buffer, GL services for stages.

Nothing is imported here, so that a program that draws nothing does not pay for VTK.
"""
