"""Films of a run: frames computed on the processor, without a browser and without a GPU.

`renderer` draws what a camera sees, `paths` move the camera, `panels` draw signals and images of
sensors, `film` puts them together, and `files` writes WebP, PNG and MP4.
"""
