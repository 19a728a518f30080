//! `epipole convert`: a model in another format.

use epipole_formats::{nerfstudio, ply, write_model_binary, write_model_text};

use crate::args::{ConvertArgs, OutFormat};
use crate::error::CliError;
use crate::{locate, output};

pub(crate) fn run(args: &ConvertArgs) -> Result<(), CliError> {
    let reconstruction = locate::read(&args.model, false)?;
    let ending = args.out.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    let format = args.format.unwrap_or(match ending.as_deref() {
        Some("ply") => OutFormat::Ply,
        Some("json") => OutFormat::Nerfstudio,
        _ => OutFormat::Binary,
    });
    let written = match format {
        OutFormat::Binary => write_model_binary(&args.out, &reconstruction),
        OutFormat::Text => {
            write_model_text(&args.out, &reconstruction).map(|warnings| output::warnings(&warnings, false))
        }
        OutFormat::Ply => ply::write_points(&args.out, &reconstruction),
        OutFormat::Nerfstudio => nerfstudio::write_nerfstudio(&args.out, &reconstruction, &args.image_folder),
    };
    written.map_err(CliError::Output)?;
    let (images, points) = (reconstruction.images.len(), reconstruction.points.len());
    output::line(&format!("{}: {images} images, {points} points", args.out.display()));
    Ok(())
}
