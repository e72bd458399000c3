"""Images, models and photographs, in and out."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.files.formats import (
        PICTURE_FORMATS as PICTURE_FORMATS,
        PictureContents as PictureContents,
        write_picture as write_picture,
    )
    from milkglass.viewer.files.images import read_image as read_image
    from milkglass.viewer.files.model import FileModel as FileModel, load_model as load_model, read_model as read_model
    from milkglass.viewer.files.photograph import Photo as Photo, load_photo as load_photo
    from milkglass.viewer.files.radiance import read_radiance as read_radiance
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
