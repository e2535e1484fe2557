#include "StripTester.hpp"
TEST(Strip, made) { Elunar::StripTester tester; tester.made(); }
TEST(Strip, madeFromPosts) { Elunar::StripTester tester; tester.madeFromPosts(); }
TEST(Strip, refusedAndBroken) { Elunar::StripTester tester; tester.refusedAndBroken(); }
int main(int argc, char** argv) { ::testing::InitGoogleTest(&argc, argv); return RUN_ALL_TESTS(); }
