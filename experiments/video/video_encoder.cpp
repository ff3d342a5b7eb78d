#include "experiments/video/video_encoder.h"

#include <cstdint>
#include <new>
#include <string>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/opt.h>
#include <libswscale/swscale.h>
}

#include "core/check.h"
#include "core/error.h"

namespace segsim::experiments::video::internal {
namespace {

template <auto kFree>
struct Freed {
  template <typename T>
  void operator()(T* owned) const {
    kFree(&owned);
  }
};
struct FreedScaler {
  void operator()(SwsContext* owned) const { sws_freeContext(owned); }
};
struct ClosedFile {
  void operator()(AVFormatContext* owned) const {
    avio_closep(&owned->pb);
    avformat_free_context(owned);
  }
};

std::string words(int error) {
  char text[AV_ERROR_MAX_STRING_SIZE] = {};
  return av_make_error_string(text, sizeof(text), error);
}

}  // namespace

struct VideoEncoder::Parts {
  std::string name;
  std::unique_ptr<AVFormatContext, ClosedFile> file;
  std::unique_ptr<AVCodecContext, Freed<avcodec_free_context>> codec;
  std::unique_ptr<AVFrame, Freed<av_frame_free>> picture;
  std::unique_ptr<AVPacket, Freed<av_packet_free>> packet;
  std::unique_ptr<SwsContext, FreedScaler> to_yuv;
  AVStream* stream = nullptr;

  /// What a library had memory for.
  template <typename T>
  static T* present(T* made) {
    if (made == nullptr) throw std::bad_alloc();
    return made;
  }
  /// Of a call on the file, negative where it failed.
  int checked(int result) const {
    if (result >= 0) return result;
    throw core::InputError::expected(name, "a place for a video", words(result));
  }
  void open_codec(const cv::Size& size, AVRational frame_duration);
  void encode(const AVFrame* frame);
};

void VideoEncoder::Parts::open_codec(const cv::Size& size, AVRational frame_duration) {
  const AVCodec* h264 = avcodec_find_encoder_by_name("libx264");
  const AVCodec* kind = h264 != nullptr ? h264 : avcodec_find_encoder(AV_CODEC_ID_MPEG4);
  if (kind == nullptr)
    throw core::InputError::expected(name, "an encoder for a video", "none");
  codec.reset(present(avcodec_alloc_context3(kind)));
  codec->width = size.width;
  codec->height = size.height;
  codec->pix_fmt = AV_PIX_FMT_YUV420P;
  codec->time_base = frame_duration;
  codec->framerate = av_inv_q(frame_duration);
  if ((file->oformat->flags & AVFMT_GLOBALHEADER) != 0) {
    codec->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
  }
  if (h264 != nullptr) {
    av_opt_set(codec->priv_data, "preset", "veryfast", 0);
    av_opt_set(codec->priv_data, "crf", "23", 0);
  } else {
    codec->flags |= AV_CODEC_FLAG_QSCALE;
    codec->global_quality = 4 * FF_QP2LAMBDA;
  }
  checked(avcodec_open2(codec.get(), kind, nullptr));
}

void VideoEncoder::Parts::encode(const AVFrame* frame) {
  checked(avcodec_send_frame(codec.get(), frame));
  for (;;) {
    const int got = avcodec_receive_packet(codec.get(), packet.get());
    if (got == AVERROR(EAGAIN) || got == AVERROR_EOF) return;
    checked(got);
    packet->stream_index = stream->index;
    packet->duration = 1;
    av_packet_rescale_ts(packet.get(), codec->time_base, stream->time_base);
    checked(av_interleaved_write_frame(file.get(), packet.get()));
  }
}

VideoEncoder::VideoEncoder(const std::filesystem::path& file,
                           const std::filesystem::path& shown_as, const cv::Size& size,
                           double frames_per_s)
    : parts_(new Parts) {
  parts_->name = shown_as.string();
  SEGSIM_CHECK(size.width % 2 == 0 && size.height % 2 == 0 && frames_per_s > 0.0,
               parts_->name);
  Parts& p = *parts_;
  av_log_set_level(AV_LOG_ERROR);  // x264 tells its statistics otherwise.
  AVFormatContext* context = nullptr;
  // The ending says what kind of file it is to be.
  const AVOutputFormat* kind = av_guess_format(nullptr, file.c_str(), nullptr);
  p.checked(avformat_alloc_output_context2(&context, kind, kind == nullptr ? "mp4" : nullptr,
                                           nullptr));
  p.file.reset(context);
  if ((context->oformat->flags & AVFMT_NOFILE) != 0) {
    throw core::InputError::expected(p.name, "a kind of file for a video, like .mp4",
                                     context->oformat->name);
  }
  p.open_codec(size, av_inv_q(av_d2q(frames_per_s, 1001)));
  p.stream = Parts::present(avformat_new_stream(context, nullptr));
  p.stream->time_base = p.codec->time_base;
  p.stream->avg_frame_rate = p.codec->framerate;
  p.checked(avcodec_parameters_from_context(p.stream->codecpar, p.codec.get()));
  p.checked(avio_open(&context->pb, ("file:" + file.string()).c_str(), AVIO_FLAG_WRITE));
  if (const int error = avformat_write_header(context, nullptr); error < 0) {
    throw core::InputError::expected(p.name, "a kind of file for a video, like .mp4",
                                     words(error));
  }
  p.packet.reset(Parts::present(av_packet_alloc()));
  p.picture.reset(Parts::present(av_frame_alloc()));
  p.picture->pts = 0;
  p.picture->format = p.codec->pix_fmt;
  p.picture->width = size.width;
  p.picture->height = size.height;
  p.checked(av_frame_get_buffer(p.picture.get(), 0));
  p.to_yuv.reset(Parts::present(sws_getContext(size.width, size.height, AV_PIX_FMT_BGR24,
                                               size.width, size.height, p.codec->pix_fmt,
                                               SWS_BICUBIC, nullptr, nullptr, nullptr)));
}

VideoEncoder::~VideoEncoder() = default;

void VideoEncoder::write(const cv::Mat& page) {
  Parts& p = *parts_;
  SEGSIM_CHECK(page.size() == cv::Size(p.codec->width, p.codec->height), p.name);
  p.checked(
      av_frame_make_writable(p.picture.get()));  // The codec may still hold the last one.
  const std::uint8_t* rows[1] = {page.data};
  const int row_bytes[1] = {static_cast<int>(page.step)};
  sws_scale(p.to_yuv.get(), rows, row_bytes, 0, page.rows, p.picture->data,
            p.picture->linesize);
  p.encode(p.picture.get());
  ++p.picture->pts;
}

void VideoEncoder::finish() {
  Parts& p = *parts_;
  p.encode(nullptr);
  p.checked(av_write_trailer(p.file.get()));
  // What the disk did not take is told at the latest here.
  p.checked(avio_closep(&p.file->pb));
}

}  // namespace segsim::experiments::video::internal
