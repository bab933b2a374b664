"""diffprt: differentiable precomputed radiance transfer.

Bake how a scene transports light, compress it, shade and render it, export it to a browser; every step is
usable alone and on plain tensors. Conventions are stated in `diffprt.sh`.

The functions, in the order in which they are used (`help(diffprt.bake)` says more):

    plan             which effects a scene needs within a tolerance: bands, bounces, shadows
    prepare          a bake before it runs: what it will cost
    bake             a scene to its transfer, how it answers to distant light
    bake_glossy      the same with a BRDF, or one for each material
    trace            the rays of a diffuse bake alone, for transfer of any albedo with gradients to it
    compress         transfer to clusters with few components
    shade            what each receiver sends out under a light, or under each of a batch
    render           a picture from a camera under a light, or under each of a batch
    tone_map         linear radiance to display values
    make_references  pictures from random views under random lights, to train on
    save_references  such pictures, or photographs, to a folder
    load_references  a folder of them back
    optimize         an asset trained towards references by gradient descent
    save             an asset to a file (.prt)
    load             a file back to its asset
    export           an asset as a page that relights it in any browser
    show             the same inside a notebook

A `Scene` has meshes and materials, an `Environment` is a map of radiance and projects to a `Light`, a `Camera` looks.
`Transfer` and `GlossyTransfer` live at `Receivers`, `ClusteredTransfer` and `ClusteredGlossyTransfer` are compressed.
Mistakes raise `InputError`, one line that says what to do.

Rooms are nouns and functions verbs, so that none hides the other; names are loaded when they are first asked for.
"""

from importlib.metadata import version

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = version("diffprt")
