#pragma once
/// Contacts of a Linux computer: single lines of /dev/gpiochip*, version 2 of the kernel's interface
/// (Linux 5.10 and later).

#include <string>
#include <system_error>

namespace esmc::hal {

/// The kernel as a line sees it: a test brings one of its own. As open(2), ioctl(2) and close(2), with errno.
struct GpioKernel {
  int (*open)(const char* path, int flags);
  int (*ioctl)(int descriptor, unsigned long request, void* argument);
  int (*close)(int descriptor);
};
extern const GpioKernel gpio_kernel;

/// One line, given back when this ends; what an output does then is the chip's affair.
class GpioLine {
 public:
  /// What the line is for.
  enum class Use {
    contact,  ///< input, with the pull-down of the chip if it has one (the kernel does not tell): open reads
              ///< low
    output,   ///< low from the instant of the request on
  };

  GpioLine() = default;
  GpioLine(const GpioLine&) = delete;
  GpioLine& operator=(const GpioLine&) = delete;
  ~GpioLine();

  /// `place`: chip and offset, "gpiochip0:17". `consumer`: what other programs are told, at most 31
  /// characters. Once per line; std::errc::invalid_argument for a place that is none, else what the kernel
  /// says (EBUSY: somebody else has the line).
  [[nodiscard]] std::error_code request(const std::string& place, Use use, const char* consumer,
                                        const GpioKernel& kernel = gpio_kernel);
  [[nodiscard]] bool is_open() const { return line_ >= 0; }

  /// hal::DigitalInput. A line that cannot be read is open. Without a request: closed, there is no contact.
  [[nodiscard]] bool closed() const;
  /// hal::DigitalOutput. Nothing without a request. False: the kernel refused.
  bool set(bool high) const;

 private:
  const GpioKernel* kernel_ = nullptr;
  int line_ = -1;
};

}  // namespace esmc::hal
