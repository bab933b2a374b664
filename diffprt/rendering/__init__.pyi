from .frozen import FrozenView as FrozenView
from .frozen import picture as picture
from .frozen import pixel_radiance as pixel_radiance
from .render import auto_exposure as auto_exposure
from .render import pixel_rays as pixel_rays
from .render import render as render
