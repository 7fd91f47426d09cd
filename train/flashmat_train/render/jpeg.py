"""What JPEG compression does to a photo, on the device the photo is on: 4:2:0 chroma, 8x8 DCT, quantisation.

The baseline standard's example tables scaled as libjpeg does; entropy coding loses nothing, so it is left out.
"""

from __future__ import annotations

import math
from functools import lru_cache

import torch
import torch.nn.functional as F
from torch import Tensor

#: Quantisation tables of ITU-T T.81, annex K.
LUMINANCE = (
    (16, 11, 10, 16, 24, 40, 51, 61),
    (12, 12, 14, 19, 26, 58, 60, 55),
    (14, 13, 16, 24, 40, 57, 69, 56),
    (14, 17, 22, 29, 51, 87, 80, 62),
    (18, 22, 37, 56, 68, 109, 103, 77),
    (24, 35, 55, 64, 81, 104, 113, 92),
    (49, 64, 78, 87, 103, 121, 120, 101),
    (72, 92, 95, 98, 112, 100, 103, 99),
)
CHROMINANCE = (
    (17, 18, 24, 47, 99, 99, 99, 99),
    (18, 21, 26, 66, 99, 99, 99, 99),
    (24, 26, 56, 99, 99, 99, 99, 99),
    (47, 66, 99, 99, 99, 99, 99, 99),
    *((99,) * 8 for _ in range(4)),
)
TO_YCC = ((0.299, 0.587, 0.114), (-0.168736, -0.331264, 0.5), (0.5, -0.418688, -0.081312))
TO_RGB = ((1.0, 0.0, 1.402), (1.0, -0.344136, -0.714136), (1.0, 1.772, 0.0))


@lru_cache
def _constants(device: torch.device) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    k, x = torch.arange(8)[:, None], torch.arange(8)[None, :]
    dct = torch.cos((2 * x + 1) * k * math.pi / 16) * torch.where(k == 0, math.sqrt(1 / 8), 0.5)
    tables = torch.tensor((LUMINANCE, CHROMINANCE, CHROMINANCE), dtype=torch.float32)
    return dct.to(device), tables.to(device), torch.tensor(TO_YCC, device=device), torch.tensor(TO_RGB, device=device)


def _quantise(planes: Tensor, table: Tensor, dct: Tensor) -> Tensor:
    """Planes (B,C,h,w) through their blocks' coefficients; `table` is (B,C,8,8)."""
    b, c, h, w = planes.shape
    blocks = planes.reshape(b, c, h // 8, 8, w // 8, 8).permute(0, 1, 2, 4, 3, 5)
    table = table[:, :, None, None]
    coefficients = torch.round(dct @ blocks @ dct.T / table) * table
    return (dct.T @ coefficients @ dct).permute(0, 1, 2, 4, 3, 5).reshape(b, c, h, w)


def jpeg(x: Tensor, quality: list[int]) -> Tensor:
    """Photos (B,3,n,n) in [0,1], n a multiple of 16, as they come back from JPEG at each one's quality (1 to 100)."""
    dct, tables, to_ycc, to_rgb = _constants(x.device)
    q = torch.tensor(quality, dtype=torch.float32)
    scale = torch.where(q < 50, 5000 / q, 200 - 2 * q).to(x.device, non_blocking=True)[:, None, None, None]
    table = torch.floor((tables * scale + 50) / 100).clamp(1, 255)
    ycc = torch.round(torch.einsum("oc,bchw->bohw", to_ycc, x * 255) - torch.tensor([128.0, 0, 0]).to(x)[:, None, None])
    luma = _quantise(ycc[:, :1], table[:, :1], dct)
    chroma = _quantise(F.avg_pool2d(ycc[:, 1:], 2), table[:, 1:], dct)
    chroma = F.interpolate(chroma, scale_factor=2, mode="bilinear", align_corners=False)
    rgb = torch.einsum("oc,bchw->bohw", to_rgb, torch.cat((luma + 128, chroma), dim=1))
    return torch.round(rgb.clamp(0, 255)) / 255
