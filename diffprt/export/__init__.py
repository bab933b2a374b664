"""From a baked asset to files that run elsewhere: one page that relights it in any browser.

`export` writes a self-contained HTML file; its shaders and scripts are the files of the folder `page`.
"""

from diffprt.export.page_file import export
from diffprt.export.representations import Packed, pack

__all__ = ["Packed", "export", "pack"]
