//! Read Exception Status and Report Server ID (APP 6.7, 6.13): requests without data.

use super::{DataModel, Plan, serves};
use crate::Adu;
use crate::data::BytesOut;
use crate::exception::Exception;
use crate::frame::LEN_MIN;
use crate::function::{PDU_MAX, READ_EXCEPTION_STATUS};

pub(super) fn prepare<M: DataModel>(
    model: &mut M,
    frame: &mut Adu,
    len: u8,
) -> Result<Plan, Exception> {
    if len != LEN_MIN {
        return Err(Exception::IllegalDataValue);
    }
    if serves::<M>(frame[1], READ_EXCEPTION_STATUS) {
        frame[2] = model.exception_status();
        return Ok(Plan::Answer { len: 3 });
    }
    let [_, _, byte_count, data @ ..] = frame;
    let (data, _) = data.split_at_mut(PDU_MAX - 2);
    let mut out = BytesOut::new(data);
    model.server_id(&mut out);
    *byte_count = out.len();
    Ok(Plan::Answer {
        len: *byte_count + 3,
    })
}
