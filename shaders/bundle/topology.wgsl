// Who belongs to whom, as one array: slots of the segments of each image (images + 1 offsets), images of each camera
// (cameras + 1 offsets), those images in order, the camera of each image, the cameras with many images; how many cameras
// have an exact block in the preconditioner, the slots of sums of each, and those cameras; then clusters of images, see
// modes.wgsl.

// Cameras with more images than this are summed by a whole workgroup.
const FEW_IMAGES = 32u;

fn cameras_at(images: u32) -> u32 {
    return images + 1u;
}

fn members_at(images: u32, cameras: u32) -> u32 {
    return images + cameras + 2u;
}

fn camera_of_at(images: u32, cameras: u32) -> u32 {
    return members_at(images, cameras) + images;
}

fn big_at(images: u32, cameras: u32) -> u32 {
    return 3u * images + cameras + 2u;
}

fn exact_at(images: u32, cameras: u32, big_cameras: u32) -> u32 {
    return big_at(images, cameras) + big_cameras;
}
