"""A tree that OctoMap 1.10 made of `scans`, as it wrote it with its log-odds (.ot) and without them (.bt)."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterator

import numpy as np

RESOLUTION, REACH = 0.25, 1.75  # meters


def scans() -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Eleven scans, some of them again and again, so that voxels reach their limits: points (24, 3) and the place of
    the sensor (3,), meters, all of them exact in float32."""
    i = np.arange(24)
    for s in (0, 1, 0, 2, 0, 0, 1, 0, 0, 3, 0):
        points = np.stack([(i * 37 + s * 11) % 64 - 32, (i * 23 + s * 29) % 64 - 32, (i * 13 + s * 5) % 32 - 16], 1)
        yield points / 16 + 1 / 64, np.array([s / 8 - 3 / 16, s / 16, 3 / 32])


def full_tree() -> bytes:
    return zlib.decompress(base64.b85decode(_FULL))


def binary_tree() -> bytes:
    return zlib.decompress(base64.b85decode(_BINARY))


_FULL = (
    r"c-"
    r"o~_K}eKQ5dL@7+I|$*Iu`Uw3WKO6F@vDpLl8l*1}a_xH}^LebT{0!LsSZ0I&|n*bXf>NIz<GLmA{9mOQ5%e2qgkNh14N3ZQF0yX8!l~Z3TPz"
    r"{`qI-&CHuOGw-#l<WM0umbzO0_Ktg=8qSP*ZoBFj_PkLw3{D}ZQt7lhu7*ZZ*(;tJ%8iYA*+TxPx;#-(qh9J-"
    r"S!V<*$Mfa?Ox9DWyvh_*CV$|F+wNx4729q;bKO%XyF1-"
    r"+FRx<9PIS5HR3YWgJsnJx08@3q#)RW6+y+bm96*F9NMBE{55yAyXaD`h`DOr7BrO7Hg)_ar9G?X&0Lm&!-"
    r"@&phN$Hn)4qG`@5d@9?02LD+R`kd+-"
    r"n7Hv1`G&~1)oJARR8A7`BxGZ!TTo<e36o)ZFXrj&uL230ZWu;z{1A(TVK322Ln&~eZg)0373KdFG>O!P;8}5(gbSF7JblV(*G)!3H0AzHUk2"
    r"@;+BzE15hBnprZVHQR;xpC&cxl>VU_9N8$~zS{2Yhywg^qpzbgwye+`J3NKi|JyMAfJU5CfnApYnEv+#9KoYrFC*>5_s1x*2hPCcbXG)|8s#"
    r";lFftbI6SJb7mhEag4ukE*W8SI5A5mJPxrf40oK`jnP3G#*#UAC1i{N9z5fuN}C{i9;JnQj`rWt<xVnyfhmf=8D0KM?ie{F|yiB7l`HKqK2r"
    r"@M*>LCW%rn0P;{#d;q<c(^|2OIm0<%2T?q;4^sXrO}987GKMdLjMM?GOwnaSjxHdAK|PF16b843<ba?Uyi>|CL!~HN1#hoq$T(a`+xCOk5{6"
    r"}yMz7i`0!BA&vzWHPqqJ13)*Q=>J#3kiP5Ne9WLrF?B9+4%h&R>&Er55(!4%JkCH<ZzIII6gSea7%Mb0gFjKLJ&u<(Q`89eDDi}H7)18i>rK"
    r"$AZD&KY{VOIKgE#|RR7eV|qizYs*_d89`g;&B+R1E_`O0G-COhrM-"
    r"3xKL@(^(2f|T~FF?5!BEB9F{9JD_g(c;(zbA)8U!8ZwyfIs^1Kiu|$zJNgLq03p3D;9s+jBqz26BEiMpYQ(>Mop*o-yb&%6a*{}Ub<-"
    r"L{Unr(<}R$cG<i{hDar&v;4vhBB4e@GL%e2dfX1Yn=>_5pnScjxW2MBkwIOoLeF*H?%Wv0G9C%VCbHMSpqFk+lI11*c=hQJARTi6ft#"
)
_BINARY = (
    r"c-nPQ-HOvd7(Ho|QbQq$bim6m^hQB681zcm*(HJAnJhC4-Z|S&-"
    r"9Ue&$qIV2eS|LPBlsQ#Zv*=XzCvIhU>w2QaQK)RzH|7_`DR8R7R_#>zSvXjwWjN8tM=b$Rjsu@qvtEF*R=ZAXm+HQOL|R<8@2tcX|daE^tP#"
    r"A()DdaYpuRo&W*OpeQn>>R+Fl!YN)E?7yitzmj6fib@g4-yEOIpx~AmSo45W_HOe;zryiKo37jM8Km{;AwfH2SaqqW*ho@IE6lJa?k{&!--"
    r"LXIvJsLQ02M+t;N+AVHQaDcR0Fxd(w5?SLZ*=6HIh-Rp&kHHpM;RDoJj*bR#;}ZG4~)$e@)8%wge=(=%gZz%Ahf;*!5Q2zlI0ZR@euHO!`s5"
    r"4OEA5RF`rD3<%2s@S|8c3sT)Dz&>tOL2ad}y<oIKRC>WCw7-jIBG=;#Ru=e}n8?+B2kGmtw(J);uWhuR%xr5kt#|YXBL>afY-"
    r"UZ<HJ<B=fNY9Q=Suz{^34*|WgX7{J!(r^Y_zQp^jgk"
)
