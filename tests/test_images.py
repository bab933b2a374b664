"""Image files keep what they are given, and damaged ones say so."""

import numpy as np
import OpenImageIO as oiio
import pytest
import torch

from diffprt.errors import InputError
from diffprt.images import read_image, write_image


def _radiance(height=16, width=32):
    generator = torch.Generator().manual_seed(1)
    image = torch.rand(height, width, 3, generator=generator) * torch.logspace(-3, 3, width)[None, :, None]
    image[3, 5] = torch.tensor([1e5, 1.0, 20.0])
    return image


def test_radiance_rgbe_is_within_one_percent_of_each_pixels_largest_channel(tmp_path):
    image = _radiance()
    write_image(tmp_path / "a.hdr", image)
    error = (read_image(tmp_path / "a.hdr") - image).abs().amax(dim=-1)
    assert bool((error <= 0.01 * image.amax(dim=-1)).all())


def test_exr_is_written_as_float32_exactly(tmp_path):
    image = _radiance()
    write_image(tmp_path / "a.exr", image)
    assert torch.equal(read_image(tmp_path / "a.exr"), image)
    assert float(read_image(tmp_path / "a.exr")[3, 5, 0]) == 1e5
    source = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    assert str(source.spec().format) == "float"
    source.close()


def test_half_float_exr_is_read_exactly(tmp_path):
    image = (_radiance() / 4).numpy().astype(np.float16)
    target = oiio.ImageOutput.create(str(tmp_path / "half.exr"))
    target.open(str(tmp_path / "half.exr"), oiio.ImageSpec(32, 16, 3, oiio.HALF))
    target.write_image(image)
    target.close()
    assert np.array_equal(read_image(tmp_path / "half.exr").numpy(), image.astype(np.float32))


def test_exr_keeps_bad_texels_for_whoever_reports_them(tmp_path):
    image = torch.zeros(2, 4, 3)
    image[0, 0], image[0, 1], image[0, 2] = float("nan"), float("inf"), -1.0
    write_image(tmp_path / "a.exr", image)
    back = read_image(tmp_path / "a.exr")
    assert bool(back[0, 0].isnan().all() and back[0, 1].isinf().all()) and float(back[0, 2, 0]) == -1.0


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("ending", [".png", ".exr"])
def test_channels_survive_and_colour_is_not_multiplied_by_alpha(tmp_path, channels, ending):
    image = torch.rand(5, 7, channels, generator=torch.Generator().manual_seed(2))
    write_image(tmp_path / f"a{ending}", image)
    tolerance = 0.5 / 255 + 1e-6 if ending == ".png" else 0
    assert read_image(tmp_path / f"a{ending}").shape == image.shape
    assert float((read_image(tmp_path / f"a{ending}") - image).abs().max()) <= tolerance


def test_radiance_repeats_one_channel(tmp_path):
    write_image(tmp_path / "a.hdr", torch.full((2, 4, 1), 0.5))
    assert torch.equal(read_image(tmp_path / "a.hdr"), torch.full((2, 4, 3), 0.5))


@pytest.mark.parametrize("ending", [".exr", ".hdr", ".png"])
@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 0.9])
def test_truncated_files_are_refused(tmp_path, ending, share):
    whole = tmp_path / f"whole{ending}"
    write_image(whole, _radiance().clamp(0, 1))
    data = whole.read_bytes()
    cut = tmp_path / f"cut{ending}"
    cut.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match="cut"):
        read_image(cut)


def test_errors_name_the_input_and_the_remedy(tmp_path):
    text = tmp_path / "text.png"
    text.write_text("not a picture")
    for path, words in (
        (text, "cannot be read"),
        (tmp_path, "is a folder"),
        (tmp_path / "no.png", "does not exist"),
    ):
        with pytest.raises(InputError, match=words) as caught:
            read_image(path)
        assert "\n" not in str(caught.value)
    for path, shape, words in (
        (tmp_path / "a.bmp", (2, 2, 3), "ending '.bmp'"),
        (tmp_path / "none" / "a.png", (2, 2, 3), "does not exist"),
        (tmp_path / "a.png", (2, 2), "has shape"),
        (tmp_path / "a.hdr", (2, 2, 4), "has shape"),
        (tmp_path / "a.exr", (2, 2, 5), "has shape"),
    ):
        with pytest.raises(InputError, match=words):
            write_image(path, torch.zeros(shape))


def test_nothing_is_left_behind(tmp_path):
    write_image(tmp_path / "a.png", torch.rand(4, 4, 3))
    write_image(tmp_path / "a.png", torch.zeros(4, 4, 3))
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]
    assert float(read_image(tmp_path / "a.png").max()) == 0
