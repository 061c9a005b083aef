"""Reshade's mathematics: arrays in, arrays out. Imports neither bpy nor anything of the add-on."""
